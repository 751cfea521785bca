"""The server of the web page: for this computer and this user, by a token and a cookie.

Every request must name this server as its host, carry the cookie and, if it has an origin, the
origin of the page. A request that changes something needs a header that no other site can set.
"""

from __future__ import annotations

import asyncio
import hmac
import json
import os
import secrets
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any

from tornado.httpserver import HTTPServer
from tornado.web import Application, HTTPError, RequestHandler, StaticFileHandler

from bayes_toe.app.job import (
    RESULTS,
    Job,
    end_group,
    is_alive,
    job_of,
    list_jobs,
    named_files,
    prepare_home,
    present_run,
    require_options,
)
from bayes_toe.arrays import Record, Texts
from bayes_toe.data.messages import format_path
from bayes_toe.errors import InputError

ADDRESS = "127.0.0.1"
LARGEST_UPLOAD = 64 * 2**20  # bytes; page.js checks it too
HEADER = "X-Bayes-Toe"
#: Seconds that reading the files of a study may take.
READING_TIME = 120
#: Seconds that a run may take to end after a signal.
ENDING_TIME = 15
#: The files of the page, each with the type of its content.
_CONTENT_TYPES = {"page.html": "text/html", "page.js": "text/javascript", "page.css": "text/css"}
_HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self' data:; connect-src 'self'; frame-src 'self'; base-uri 'none'; "
    "form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}
#: The report has scripts inside, so that it gets an origin of its own.
_REPORT_POLICY = "sandbox allow-scripts allow-downloads; frame-ancestors 'self'"


@dataclass
class Site:
    """State that the handlers share: the home folder, the port and the token."""

    home: Path
    port: int
    token: str = field(default_factory=secrets.token_hex)
    #: The token in addresses of results: links in a report have an origin of their own, and no
    #: cookie.
    key: str = field(default_factory=secrets.token_hex)
    #: The record that reading gave, by the study and its command.
    readings: dict[Texts, Record] = field(default_factory=dict)
    #: One reading at a time, so that the last reading belongs to the last options.
    reading_lock: asyncio.Lock = field(default_factory=asyncio.Lock)
    #: The process of the last run. While it is referenced here, Python collects its exit code.
    process: subprocess.Popen[bytes] | None = None

    @property
    def host(self) -> str:
        """The host of every request."""
        return f"{ADDRESS}:{self.port}"

    @property
    def cookie(self) -> str:
        """The name of the cookie; browsers share cookies between ports."""
        return f"bayes_toe_{self.port}"

    async def read(self, job: Job, options: Record | None = None) -> Record:
        """Return the record of the files of a study, which :func:`read_in_process` describes.

        New options are saved first, and then the files are read anew. Without new options, the
        record of an earlier reading under the same options is returned, if there is one.
        """
        async with self.reading_lock:
            if options is not None:
                job.save_options(options)
            key = (job.name, *job.command())  # The command has the options.
            if options is not None or key not in self.readings:
                reading = await read_in_process(job)
                key = (job.name, *job.command())  # the reading may have found options
                self.readings[key] = reading
        return self.readings[key]

    async def stop(self) -> None:
        """End the run: ask it to end, and kill it if it goes on for :data:`ENDING_TIME`.

        A run that outlived its server is ended, too.

        Raises
        ------
        InputError
            If the run belongs to another server, which is still there.
        """
        run = present_run(self.home)
        if run is None:
            return
        if run.server != os.getpid() and is_alive(run.server):
            raise InputError("Another server of this folder has started the run. Stop it there.")

        for number in (signal.SIGTERM, signal.SIGKILL):
            end_group(run.group, number)
            for _ in range(ENDING_TIME * 10):  # ten times a second
                if present_run(self.home) is None:
                    return
                await asyncio.sleep(0.1)


async def read_in_process(job: Job) -> Record:
    """The record of :func:`~bayes_toe.app.reading.read_job`, which another process makes.

    If the process fails, the record has only the problem.
    """
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-P", "-m", "bayes_toe.app.reading", str(job.folder)),
        cwd=job.folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )
    try:
        printed, _ = await asyncio.wait_for(process.communicate(), READING_TIME)
        return json.loads(printed)
    except TimeoutError:
        process.kill()
        await process.wait()
        problem = f"Reading takes longer than {READING_TIME} seconds."
    except ValueError:  # The process has died, and its output is no JSON.
        problem = "The file cannot be read. It is probably damaged."
    return {"table": None, "problems": [problem], "remedies": [], "study": None}


# --- Requests -------------------------------------------------------------------------------------


class Handler(RequestHandler):
    """A request of the page, refused unless it comes from the page."""

    @property
    def site(self) -> Site:
        """State that the handlers share."""
        return self.application.settings["site"]

    def set_default_headers(self) -> None:
        """Keep pages out of caches, frames and other origins, by the headers of every answer."""
        self.clear_header("Server")
        for name, value in _HEADERS.items():
            self.set_header(name, value)

    def prepare(self) -> None:
        """Refuse a request of another site, without the token, or without the header."""
        host = self.request.headers.get("Host")
        origin = self.request.headers.get("Origin")
        if host != self.site.host or origin not in (None, f"http://{self.site.host}"):
            raise HTTPError(403, reason="Another site may not use this page")

        token = self.token() or ""
        if not hmac.compare_digest(token.encode(), self.site.token.encode()):
            raise HTTPError(403, reason="Open the address that bayes-toe app has printed")

        if self.request.method == "POST" and HEADER not in self.request.headers:
            raise HTTPError(403, reason=f"The header {HEADER} is missing")

    def token(self) -> str | None:
        """The token that the request has, here that of the cookie; None without one."""
        return self.get_cookie(self.site.cookie)

    def job(self, name: str) -> Job:
        """The study with this name, which the address has."""
        job = Job(self.site.home / name)
        if not job.folder.is_dir():
            raise HTTPError(404, reason="There is no such study")
        return job

    async def send_state(self, job: Job) -> None:
        """Send all that the page shows of a study."""
        reading = await self.site.read(job)
        results = f"results/{self.site.key}/{job.name}/"  # the address of the results
        self.finish({**job.state(), "reading": reading, "results": results})

    def log_exception(self, kind: Any, error: Any, trace: Any) -> None:
        """Log bugs, not errors that :meth:`send_error` explains on the page."""
        if not isinstance(error, InputError | OSError):
            super().log_exception(kind, error, trace)

    def send_error(self, status_code: int = 500, **details: Any) -> None:
        """Answer with the problem of a bad input (400), of a folder (507), or of an HTTPError.

        Tornado calls it with the class, the exception and its traceback in `details`.
        """
        _, error, _ = details["exc_info"]
        self.clear()  # headers and content of the answer so far

        if isinstance(error, InputError):
            self.set_status(400)
            problem = str(error)
        elif isinstance(error, OSError):
            self.set_status(507)
            # An OutputError is an OSError without a number. Its cause is the error of the system.
            reason = getattr(error.__cause__ or error, "strerror", None) or error
            problem = f"The folder {self.site.home} cannot be used: {reason}"
        else:
            self.set_status(status_code, getattr(error, "reason", None))
            problem = self._reason  # from set_status: the reason, or else the words for the code
        self.finish({"problem": problem})


class Page(Handler):
    """The page itself; a token in its address stands for the cookie and sets it."""

    def token(self) -> str | None:
        """The token of the address, or else of the cookie, which may be an old token."""
        return self.get_query_argument("token", None) or super().token()

    def get(self, name: str) -> None:
        """Send a file of the page; `name` is 'page.js', 'page.css', or '' for the page itself.

        The route of :func:`application` lets no other name pass, so that no other file is read.
        """
        name = name or "page.html"
        site = self.site
        self.set_cookie(site.cookie, site.token, httponly=True, samesite="Strict", path="/")
        self.set_header("Content-Type", _CONTENT_TYPES[name])
        self.finish((files("bayes_toe.app") / name).read_bytes())


class Jobs(Handler):
    """The studies of the folder."""

    def get(self) -> None:
        """List the studies with their states, and the names of damaged studies."""
        studies, damaged = list_jobs(self.site.home)
        jobs = []
        for job in studies:
            jobs.append({"id": job.name, "run": job.run_state(), **job.record()})
        self.finish({"jobs": jobs, "damaged": damaged})

    async def post(self) -> None:
        """Store dropped files as a study, or open the study of these files, and read them."""
        dropped = self.request.files.get("files", [])
        files = named_files([(file.filename, file.body) for file in dropped])
        job = job_of(self.site.home, files)
        job.store(files)
        await self.send_state(job)


class OneJob(Handler):
    """One study: its state, and what changes it."""

    async def get(self, name: str, _: str) -> None:
        """Send all that the page shows of the study."""
        await self.send_state(self.job(name))

    async def post(self, name: str, action: str) -> None:
        """Do what a button of the page says, and send the state of the study afterwards."""
        job = self.job(name)
        site = self.site
        is_running = job.run_state() == "running"
        if action == "options":
            if is_running:
                raise InputError("The study is being analysed")
            await site.read(job, require_options(self.request.body))
        elif action == "run":
            if (await site.read(job))["study"] is None:
                raise InputError("A question about the file is open")
            site.process = job.start()
        elif is_running:  # The other actions are 'stop' and 'delete', and both end the run.
            await site.stop()

        if action == "delete":
            shutil.rmtree(job.folder)
            self.finish({})
        else:
            await self.send_state(job)


class Results(Handler, StaticFileHandler):
    """Files of a results folder; :data:`_REPORT_POLICY` gives them an origin of their own."""

    def token(self) -> str | None:
        """The token of this server, if the address has the key of results, 'KEY/STUDY/FILE'."""
        key, _, _ = self.path_args[0].partition("/")
        if hmac.compare_digest(key, self.site.key):
            return self.site.token
        return None

    async def get(self, path: str, include_body: bool = True) -> None:
        """Send a file of the folder; the path is 'KEY/STUDY/FILE'."""
        _, name, file = path.split("/", 2)
        if "\0" in file:  # No name of a file has this character, and opening it raises.
            raise HTTPError(404)
        self.root = str(self.job(name).folder / RESULTS)
        self.set_header("Content-Security-Policy", _REPORT_POLICY)
        await super().get(file, include_body)

    def compute_etag(self) -> None:
        """Give a file no mark of its content.

        Tornado would store the mark, and send it also after another run has changed the file.
        """


def application(site: Site) -> Application:
    """The application of Tornado: which handler answers requests to which address."""
    return Application(
        [
            (r"/(|page\.js|page\.css)", Page),
            ("/api/jobs", Jobs),
            ("/api/jobs/([0-9a-f]{16})(?:|/(options|run|stop|delete))", OneJob),
            # The path is empty here: `Results.get` sets the folder of the study for each request.
            ("/results/([0-9a-f]+/[0-9a-f]{16}/.+)", Results, {"path": ""}),
        ],
        default_handler_class=Handler,
        log_function=lambda _: None,  # Log no request, because its address may hold the token.
        site=site,
    )


# --- The command ----------------------------------------------------------------------------------


def serve(home: Path, port: int, ready: Callable[[str], None]) -> int:
    """Serve the page until a signal arrives; return the signal's number.

    Parameters
    ----------
    home : Path
        The folder of the studies; it is made where it is missing. `~` is the user's home folder.
    port : int
        0 takes a free one.
    ready : callable
        Called with the address of the page.

    Raises
    ------
    InputError, OutputError
        If the folder or the port cannot be used.
    """
    if os.name != "posix":
        raise InputError("app needs Linux or macOS; on Windows use WSL")
    expanded_home = Path(os.path.expanduser(home))
    # An empty HOME makes '/x' of '~/x', and an unknown user's '~name/x' stays as it is.
    is_expanded = os.environ.get("HOME") != "" and expanded_home.is_absolute()
    if str(home).startswith("~") and not is_expanded:
        raise InputError(
            f"{format_path(home)}: there is no such home folder; name a folder with --folder"
        )
    prepare_home(expanded_home)
    return asyncio.run(_serve(expanded_home.resolve(), port, ready))


async def _serve(home: Path, port: int, ready: Callable[[str], None]) -> int:
    """Serve the page, as :func:`serve` does, from a home folder that exists."""
    try:
        listening = socket.create_server((ADDRESS, port))
    except OSError as error:
        reason = os.strerror(error.errno or 0)
        raise InputError(
            f"port {port}: cannot be used ({reason}); --port 0 takes a free one"
        ) from None
    listening.setblocking(False)

    site = Site(home, listening.getsockname()[1])
    server = HTTPServer(application(site), max_body_size=LARGEST_UPLOAD)
    server.add_socket(listening)

    signals: asyncio.Queue[int] = asyncio.Queue()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        asyncio.get_running_loop().add_signal_handler(number, signals.put_nowait, number)
    ready(f"http://{site.host}/?token={site.token}")
    first_signal = await signals.get()

    server.stop()
    # A run of another server of the folder goes on.
    if site.process is not None and site.process.poll() is None:
        await site.stop()
    return first_signal
