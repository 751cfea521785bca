"""The web page: who may use it, what it reads and runs, what stays after a restart."""

import asyncio
import json
import os
import re
import resource
import shlex
import shutil
import signal
import socket
import stat
import subprocess
import sys
import time
from contextlib import closing, contextmanager, suppress
from email.message import Message
from http.client import HTTPConnection
from itertools import product
from pathlib import Path
from threading import Thread
from typing import NamedTuple
from urllib.parse import urlsplit

import pytest
from browsers import BrowserPage
from commands import run_command, run_ok
from conftest import each_row, refused
from processes import wait_until

pytest.importorskip("tornado")
from bayes_toe.app.job import end_group, job_of, list_jobs, named_files, prepare_home, present_run
from bayes_toe.app.server import read_in_process
from bayes_toe.errors import OutputError

CODES = {"columns": {"s1": "stim1", "s2": "stim2"}, "second_code": "2"}
#: Trials of four pairs: the stronger stimulus is named, or the weaker one.
RIGHT = "{0},0.0,0.3,2\n{0},0.3,0.0,1\n{0},0.3,0.6,2\n{0},0.6,0.3,1\n"
WRONG = "{0},0.0,0.3,1\n{0},0.3,0.0,2\n{0},0.3,0.6,1\n{0},0.6,0.3,2\n"


def write_trials(path, subjects=("A", "B")):
    """Write trials of subjects, with codes and column names that need an answer.

    Each subject has 20 trials of each of four pairs, of which 16 are right.
    """
    rows = "".join(map((16 * RIGHT + 4 * WRONG).format, subjects))
    path.write_text(f"participant,stim1,stim2,answer\n{rows}")
    return path


class Answer(NamedTuple):
    # Of a server to a request.
    code: int
    headers: Message
    body: bytes


def json_of(answer):
    """The JSON of an answer to a request that is granted."""
    assert answer.code == 200, answer.body
    return json.loads(answer.body)


#: The program, which waits longer before it ends a run by force: the machine may be busy.
PATIENT_PROGRAM = """
from bayes_toe.app import server
from bayes_toe.cli.entry_point import main
server.ENDING_TIME = 300
main()
"""
#: The same program, which reads files itself: a new process for each choice takes long.
READING_PROGRAM = f"""
from contextlib import chdir
from bayes_toe.app import reading, server
async def read_here(job):
    with chdir(job.folder):
        return reading.read_job(job)
server.read_in_process = read_here
{PATIENT_PROGRAM}
"""


class Server:
    """A running `bayes-toe app`, and requests to it as the page makes them."""

    def __init__(self, folder, port, program):
        words = [sys.executable, "-c", program, "app", "--folder", folder]
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        self.process = subprocess.Popen([*words, "--port", str(port)], **pipes)
        self.process.stdout.readline()
        self.address = self.process.stdout.readline().strip()
        parts = urlsplit(self.address)
        self.host = parts.netloc
        self.token = parts.query.removeprefix("token=")
        self.cookie = f"bayes_toe_{parts.port}={self.token}"

    def ask(self, path, body=None, **headers):
        """The answer to a request that the page could have sent, with some headers changed.

        Without a body it is a GET request. A header that is None is not sent.
        """
        sent = {"Cookie": self.cookie, "X-Bayes-Toe": "1", **headers}
        sent = {name: value for name, value in sent.items() if value is not None}
        with closing(HTTPConnection(self.host, timeout=60)) as connection:
            connection.request("GET" if body is None else "POST", path, body, sent)
            answer = connection.getresponse()
            return Answer(answer.status, answer.headers, answer.read())

    def study(self, study_id, action="", body=None, **headers):
        """The answer to a request about a study."""
        return self.ask(f"/api/jobs/{study_id}{action}", body, **headers)

    def state(self, study_id, action="", body=None):
        """The state of a study, after an action."""
        return json_of(self.study(study_id, action, body))

    def upload(self, *files):
        """The answer to new files, each a name and its content."""
        body = b""
        for name, content in files:
            head = f'Content-Disposition: form-data; name="files"; filename="{name}"'
            body += b"--b\r\n" + head.encode() + b"\r\n\r\n" + content + b"\r\n"
        kind = "multipart/form-data; boundary=b"
        return self.ask("/api/jobs", body + b"--b--\r\n", **{"Content-Type": kind})

    def add(self, name, data):
        """The state of a new study of one file."""
        return json_of(self.upload((name, data)))

    def add_trials(self, study_file, options=CODES):
        """Upload a file of trials with options, and return the id of the new study."""
        study_id = self.add(study_file.name, study_file.read_bytes())["id"]
        self.state(study_id, "/options", json.dumps(options))
        return study_id

    def wait(self, study_id, is_reached):
        """Wait until something is true of the state of a study, and return the state."""
        for _ in range(3000):
            state = self.state(study_id)
            if is_reached(state):
                return state
            time.sleep(0.2)
        raise AssertionError(state)

    def end(self):
        """End the program as Ctrl+C does; its exit code and errors."""
        self.process.send_signal(signal.SIGINT)
        _, errors = self.process.communicate(timeout=120)
        return self.process.returncode, errors


@contextmanager
def serving(folder, port=0, program=PATIENT_PROGRAM):
    server = Server(folder, port, program)
    try:
        yield server
    finally:
        if server.process.poll() is None:
            server.end()


@pytest.fixture(scope="module")
def home_folder(tmp_path_factory):
    # The folder of the server, which makes it.
    return tmp_path_factory.mktemp("app") / "home"


@pytest.fixture(scope="module")
def server(home_folder):
    with serving(home_folder, program=READING_PROGRAM) as running:
        yield running


@pytest.fixture(scope="module")
def study_id(server, tmp_path_factory):
    # The id of a study of two subjects, which lacks options and was never run.
    study_file = write_trials(tmp_path_factory.mktemp("study") / "study.csv")
    return server.add_trials(study_file, {})


# --- the folder -----------------------------------------------------------------------------------

TWO_FILES = {"u.csv": b"subject,s1\n1,2\n", "v.csv": b"subject,s1\n3,4\n"}


def test_files_get_different_names_of_bounded_length():
    # Names that differ in their last characters alone; only those of 400 bytes are shortened.
    short = [f"{'a' * 60}1.csv", f"{'a' * 60}2.csv"]
    long = [f"{'ä' * 200}1.csv", f"{'ä' * 200}2.csv"]
    files = named_files([(name, b"x") for name in short + long])
    assert set(short) < set(files)
    assert len(files) == 4
    assert max(len(name.encode()) for name in files) < 130


#: Names of files that are no tables, or that are equal where capitals and signs do not count, and
#: no file at all.
REFUSED_FILES = """
    x.xls | 'x.xls': the page reads files
    x | 'x': the page reads files
    .csv | '.csv': the page reads files
    a.csv a.csv | 'a.csv' and 'a.csv' get one name
    a?.csv A*.csv | get one name
    | A study is one file
"""


@each_row("names, message", REFUSED_FILES)
def test_files_that_are_no_tables_or_get_one_name_are_refused(names, message):
    with refused(message):
        named_files([(name, b"x") for name in names.split()])


def test_folders_of_others_and_damaged_studies_are_named_and_can_be_stored_again(tmp_path):
    # Three damaged studies with names as the program makes them, and folders of other programs.
    records = {"0" * 16: "", "1" * 16: "[]", "2" * 16: '{"files": ["../x.csv"]}', "exp": "{}"}
    for name, record in records.items():
        (tmp_path / name).mkdir()
        (tmp_path / name / "study").write_text(record)
    (tmp_path / "mine" / "study").mkdir(parents=True)
    job = job_of(tmp_path, TWO_FILES)
    prepare_home(tmp_path)
    job.store(TWO_FILES)
    for name in ("command", "study"):
        (job.folder / name).write_text("")  # as after a loss of power
    # No study is whole, and all folders are named.
    assert list_jobs(tmp_path) == ([], sorted([job.name, *records, "mine"]))
    job.store(TWO_FILES)
    assert list_jobs(tmp_path) == ([job], sorted([*records, "mine"]))
    assert job.run_state() == "new"
    # Nobody but the user may read it.
    assert stat.S_IMODE(job.folder.stat().st_mode) == 0o700


def test_a_lock_that_is_a_link_is_refused_and_its_target_stays(tmp_path):
    notes = tmp_path / "notes"
    notes.write_text("of the user")
    (tmp_path / ".bayes_toe_app.lock").symlink_to(notes)
    with refused(str(tmp_path), OutputError):
        prepare_home(tmp_path)
    assert notes.read_text() == "of the user"


def require_error_line(refusal, text):
    """The command ended with exit code 2, and its only line is an error with this text."""
    assert (refusal.returncode, refusal.stdout) == (2, "")
    assert len(refusal.stderr.splitlines()) == 1
    assert text in refusal.stderr


def test_a_folder_or_port_that_cannot_be_used_is_one_line(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    require_error_line(
        run_command("app --folder", tmp_path / "file"), "cannot be written (File exists)"
    )
    with closing(socket.create_server(("127.0.0.1", 0))) as other:
        port = other.getsockname()[1]
        require_error_line(
            run_command("app --folder", tmp_path / "home", "--port", port), "cannot be used"
        )
    for folder, users_home in (
        ("~nobody_x/y", "/"),  # there is no such user
        ("~/x", ""),  # HOME is empty
        ("~", "x"),  # HOME is a relative path
        (None, ""),  # the folder by default
    ):
        monkeypatch.setenv("HOME", users_home)
        words = ["app"] if folder is None else ["app", "--folder", folder]
        require_error_line(run_command(*words), "there is no such home folder")


def test_a_reader_that_takes_too_long_is_ended(monkeypatch, tmp_path):
    # Files are read in another process, which needs longer than 0.01 seconds to start.
    monkeypatch.setattr("bayes_toe.app.server.READING_TIME", 0.01)
    job = job_of(tmp_path, TWO_FILES)
    job.store(TWO_FILES)
    reading = asyncio.run(read_in_process(job))
    assert reading["problems"] == ["Reading takes longer than 0.01 seconds."]


# --- requests -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "example.org"},
        {"Host": "localhost:80"},
        {"Origin": "http://example.org"},
        {"Origin": "null"},
        {"Cookie": None},
        {"Cookie": "bayes_toe_1=wrong"},
        {"X-Bayes-Toe": None},
    ],
    ids=str,
)
def test_requests_of_others_are_refused(server, study_id, headers):
    # A page of another site can send requests to this server, but not with its host and cookie, its
    # origin, and the header of its own. Requests that change nothing (GET) need no such header.
    for path in (f"/api/jobs/{study_id}/run", f"/api/jobs/{study_id}/delete", "/api/jobs"):
        assert server.ask(path, "", **headers).code == 403
    if "X-Bayes-Toe" not in headers:
        for path in ("/", "/page.js", "/api/jobs", f"/api/jobs/{study_id}", "/nothing"):
            assert server.ask(path, **headers).code == 403
    assert server.state(study_id)["run"] == "new"


@pytest.mark.parametrize(
    "path",
    [
        *("/../study", "/%2e%2e/study", "/..%2fstudy", "//etc/passwd", "/%2fetc%2fpasswd"),
        *("/./report.html", "/report.html%00.png"),
    ],
)
def test_only_files_of_the_results_are_sent(server, study_id, path):
    # Paths that lead out of the folder of results, and an address with a wrong key in place of the
    # results'.
    results = server.state(study_id)["results"]
    assert server.ask(f"/{results}{path[1:]}").code in (403, 404)
    assert server.ask(f"/results/0123/{study_id}{path}").code == 403


def test_the_token_in_the_address_sets_a_cookie_that_replaces_an_old_one(server):
    # The cookie bayes_toe_PORT=TOKEN is that with which the page makes all later requests.
    name, _, _ = server.cookie.partition("=")
    answer = server.ask(f"/?token={server.token}", Cookie=f"{name}=old")
    assert answer.code == 200
    cookie = answer.headers["Set-Cookie"]
    assert cookie.startswith(server.cookie)
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    assert server.ask("/?token=wrong").code == 403


def test_the_page_runs_no_scripts_of_others(server):
    assert "unsafe" not in server.ask("/").headers["Content-Security-Policy"]


@pytest.mark.parametrize(
    "body",
    [
        *("{", "", "[1]", "3", '{"output": "x"}', '{"columns": {"s1": 3}}', '{"swap": "A"}'),
        *("[" * 100_000, '{"a":' * 100_000),
    ],
    ids=lambda body: body[:20],
)
def test_options_of_a_wrong_form_are_a_bad_request(server, study_id, body):
    # What is no JSON, or no object, has a wrong name or a value of a wrong type, or is too deep.
    assert server.study(study_id, "/options", body).code == 400


def test_unknown_names_of_studies_and_actions_are_not_found(server, study_id):
    # An id that no study has, the folder above, and the id of a study in capitals with a letter
    # more.
    for name in ("0" * 16, "..", f"{study_id.upper()}x"):
        assert server.study(name).code in (404, 405)


def test_a_damaged_study_is_a_bad_request_and_a_deleted_one_is_gone(server, home_folder):
    # The name of the file is that of a path, with signs that a shell or a page could obey.
    state = server.add("../../-a<b>.csv", b"subject,s1\n")
    folder = home_folder / state["id"]
    assert {path.name for path in folder.iterdir()} == {"a_b_.csv", "study"}
    assert stat.S_IMODE(home_folder.stat().st_mode) == 0o700

    # The record is damaged, as after a loss of power, and restored.
    record = (folder / "study").read_bytes()
    (folder / "study").write_text("")
    assert folder.name in json_of(server.ask("/api/jobs"))["damaged"]
    assert server.study(folder.name).code == 400
    assert server.study(folder.name, "/delete", "").code == 400
    (folder / "study").write_bytes(record)
    server.state(folder.name, "/delete", "")
    assert not folder.exists()


def test_a_large_upload_is_refused(server, home_folder):
    # An upload may have 64 MiB.
    folders = set(home_folder.iterdir())
    with suppress(OSError):  # The server may close the connection before it has read all.
        assert server.upload(("x.csv", bytes(65 * 2**20))).code in (400, 413)
    assert server.ask("/api/jobs").code == 200
    assert set(home_folder.iterdir()) == folders


@pytest.mark.skipif(not hasattr(resource, "prlimit"), reason="limits of a process need Linux")
def test_a_full_disk_is_a_line_on_the_page(server, home_folder, study_id):
    # For a while the server may write files of 0 bytes. A new file and new options are refused with
    # the HTTP code 507, insufficient storage.
    folders = set(home_folder.iterdir())
    earlier = server.state(study_id)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    _, hard_limit = limits
    no_bytes = (0, hard_limit)
    resource.prlimit(server.process.pid, resource.RLIMIT_FSIZE, no_bytes)
    answers = [server.upload(("new.csv", b"subject,s1,s2\nA,0,1\n"))]
    answers.append(server.study(study_id, "/options", "{}"))
    resource.prlimit(server.process.pid, resource.RLIMIT_FSIZE, limits)
    for answer in answers:
        assert answer.code == 507
        assert "File too large" in json.loads(answer.body)["problem"]
    assert set(home_folder.iterdir()) == folders
    assert server.state(study_id) == earlier


@pytest.mark.parametrize(
    "name, content",
    [
        ("x.mat", b"MATLAB 5.0" + bytes(100)),
        ("x.csv", b"\xff\xfe\x00"),
        ("x.csv", b""),
    ],
)
def test_a_damaged_file_has_no_table_and_a_problem(server, name, content):
    # A MATLAB file that ends too early, bytes that are no text, and an empty file.
    reading = server.add(name, content)["reading"]
    assert reading["table"] is None
    assert reading["problems"]


def test_names_that_no_command_can_type_and_wrong_numbers_are_problems(server):
    # --columns separates its names by commas and =, which this name of a column has.
    header = b'subject,s1,s2,"response (1, a=2)"\nA,0,0.3,1\n'
    study_id = server.add("x.csv", header)["id"]
    for options in ({"columns": {"response": "response (1, a=2)"}}, {"intensity": "x"}):
        state = server.state(study_id, "/options", json.dumps(options))
        assert len(state["reading"]["problems"]) == 1
        assert state["reading"]["table"]["names"][0] == "subject"
        assert server.study(study_id, "/run", "").code == 400


# --- the run --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def study_file(tmp_path_factory):
    return write_trials(tmp_path_factory.mktemp("trials") / "my study.csv")


def continue_when_signalled(group):
    """Let a stopped process go on as soon as a signal waits for it."""
    status = Path(f"/proc/{group}/status")
    wait_until(lambda: not re.search("ShdPnd:\\s0+\n", status.read_text()))
    end_group(group, signal.SIGCONT)


@pytest.fixture(scope="module")
def finished(tmp_path_factory, study_file):
    """A server and the folder of its study, of two subjects, whose run has ended.

    The run outlived its first server, was stopped under the next one, and went on to the end. Only
    the first server reads files in a process of its own.
    """
    home_folder = tmp_path_factory.mktemp("finished")
    with serving(home_folder) as first:
        study_id = first.add_trials(study_file)
        first.state(study_id, "/run", "")
        first.wait(study_id, lambda state: state["done"] > 0)
        group = present_run(home_folder).group
        end_group(group, signal.SIGSTOP)  # the run waits until the next server is there
        first.process.kill()
        assert first.process.communicate()[1] == ""

    with serving(home_folder, urlsplit(first.address).port, READING_PROGRAM) as second:
        assert second.state(study_id)["run"] == "running"
        # The run goes on when it has the signal to stop, since it might else end before that.
        Thread(target=continue_when_signalled, args=[group]).start()
        stopped = second.state(study_id, "/stop", "")
        assert stopped["run"] == "stopped"
        assert stopped["done"] > 0
        assert "stopped by SIGTERM" in stopped["log"]

        second.state(study_id, "/run", "")
        finished_state = second.wait(study_id, lambda state: state["run"] == "done")
        assert "taken from results.partial" in finished_state["log"]
        yield second, home_folder / study_id


def test_results_equal_those_of_the_command_to_the_bit(finished, study_file, tmp_path):
    server, folder = finished
    command = server.state(folder.name)["command"]
    shutil.copy(study_file, tmp_path)
    run_ok(*shlex.split(command)[1:], "--figures", "none", cwd=tmp_path)
    # The command that the page shows, typed in another folder, gives the same tables.
    tables = {path.name: path.read_bytes() for path in (tmp_path / "results").glob("*.csv")}
    _header, *subject_rows = tables["evidence.csv"].decode().splitlines()
    assert [row.partition(",")[0] for row in subject_rows] == ["A", "B"]
    for name, content in tables.items():
        assert (folder / "results" / name).read_bytes() == content, name


def test_the_report_has_an_origin_of_its_own_and_the_page_names_its_folder(finished):
    # The report is sent without a cookie, from an address that only the page knows, and in a
    # sandbox: its scripts cannot act for the page.
    server, folder = finished
    results = server.state(folder.name)["results"]
    assert server.ask(f"/{results}methods.md", Cookie=None).code == 200
    report = server.ask(f"/{results}report.html", Cookie=None)
    policy = report.headers["Content-Security-Policy"]
    assert policy.startswith("sandbox allow-scripts allow-downloads;")
    assert b"my study.csv" in report.body
    assert server.state(folder.name)["folder"] == str(folder / "results")


def test_a_run_is_the_only_one_and_ends_with_its_server_alone(tmp_path, study_file):
    with serving(tmp_path, program=READING_PROGRAM) as server:
        study_id = server.add_trials(study_file)
        other = server.add_trials(write_trials(tmp_path / "other.csv"))
        server.state(study_id, "/run", "")
        assert server.study(other, "/run", "").code == 400
        assert server.study(study_id, "/options", "{}").code == 400
        with serving(tmp_path) as second_server:  # whose end leaves the run of the first server
            assert second_server.state(study_id)["run"] == "running"
            for action in ("/stop", "/delete"):
                assert second_server.study(study_id, action, "").code == 400
            assert second_server.end() == (128 + signal.SIGINT, "")
        assert server.state(study_id)["run"] == "running"
        group = present_run(tmp_path).group
        assert server.end() == (128 + signal.SIGINT, "")
    with pytest.raises(ProcessLookupError):
        os.killpg(group, 0)  # a signal that only asks whether somebody is there


# --- in a browser ---------------------------------------------------------------------------------


class AppPage(BrowserPage):
    """The page of a server in a browser, with actions as a user does them."""

    def __init__(self, browser, server, width=1200, **options):
        self.server = server
        super().__init__(browser, self, width, **options)

    def as_uri(self):
        return self.server.address

    def add(self, *files):
        self.page.set_input_files("#files", files)
        self.page.locator("#reading").wait_for()
        self.settle()

    def settle(self):
        self.page.locator("main[aria-busy=false]").wait_for()

    def study_id(self):
        """The id of the study that is shown, which stands in the address."""
        _, _, shown_id = self.page.url.partition("#")
        return shown_id

    def study(self):
        """The state of the study that is shown, from the server."""
        return self.server.state(self.study_id())

    def enter(self, fields):
        """Choose or type in fields, one after another, as fast as they are there."""
        for selector, value in fields.items():
            if self.page.locator(selector).evaluate("field => field.matches('input')"):
                self.page.fill(selector, value)
                self.page.press(selector, "Tab")
            else:
                self.page.select_option(selector, value)
        self.settle()

    def press(self, selector, *keys):
        """Press Tab until an element has the focus, as somebody without a mouse does; then keys."""
        for _ in range(60):  # more than the page has elements
            if self.page.locator(selector).first.evaluate("e => e === document.activeElement"):
                break
            self.page.keyboard.press("Tab")
        else:
            raise AssertionError(selector)
        for key in keys:
            self.page.keyboard.press(key)
        self.settle()

    def wait(self, state):
        self.page.locator(f"#run[data-state={state}]").wait_for()

    def close(self):
        """Close the page, which asked nobody else for anything, and had no problem."""
        self.page.close()
        own_address = f"http://{self.server.host}/"
        problems = [problem for problem in self.problems if not problem.startswith(own_address)]
        assert problems == []


@pytest.fixture
def app_page(browser, server):
    page = AppPage(browser, server)
    yield page
    page.close()


def test_the_keyboard_alone_leads_from_the_file_to_a_run_that_stops_and_goes_on(app_page, tmp_path):
    # The names of the subjects are no markup.
    app_page.add(write_trials(tmp_path / "study.csv", ("<b>A</b>", "<script>alert(1)</script>")))
    page = app_page.page
    assert "token" not in page.url
    assert page.locator("#go").is_disabled()
    assert "Choose the column of: first stimulus" in page.inner_text("[data-field=stimuli]")
    # The answer to each question is one button, the second one for what the codes mean.
    app_page.press("[data-field=stimuli] button", "Enter")
    assert "does not know what they mean" in page.inner_text("[data-field=meaning]")
    app_page.press("[data-field=meaning] button", "Tab", "Enter")
    assert page.locator(".question, #rows td b").count() == 0
    assert "+35 %" in page.inner_text("#pairs")  # the pair (0.0, 0.3): exp(0.3) is 1.35
    # The run stops at once, stays stopped when the page is loaded again, goes on, and stops.
    app_page.press("#go", "Enter")
    app_page.press("#stop", "Enter")
    app_page.wait("stopped")
    page.reload()
    app_page.wait("stopped")
    app_page.press("#go", "Enter")
    app_page.wait("running")
    app_page.press("#stop", "Enter")
    app_page.wait("stopped")


def test_all_four_parts_are_there_in_another_tab_and_other_options_hide_the_results(
    browser, finished
):
    # The study's run has ended. With another decimal sign the results are not those of the options,
    # until the old choice is back.
    server, folder = finished
    app_page = AppPage(browser, server)
    page = app_page.page
    page.locator(f"#studies a[href='#{folder.name}']").click()
    app_page.wait("done")
    report = page.frame_locator("#report")
    report.get_by_role("link", name="methods.md").first.click()
    report.get_by_text("For each").first.wait_for()
    for section in ("#start", "#reading", "#run", "#results"):
        assert page.locator(section).is_visible()
    assert "--second-code 2" in page.inner_text("#command")
    assert page.locator("#go").is_hidden()
    page.select_option("#decimal", ".")
    page.locator("#go").wait_for()
    assert page.locator("#results").is_hidden()
    page.select_option("#decimal", "")
    app_page.wait("done")
    assert page.inner_text("#folder").endswith("results")
    app_page.close()


def test_answers_belong_to_their_study_while_another_is_on_its_way(app_page, server, tmp_path):
    page = app_page.page
    sent = []  # the options of each request
    held = []  # the requests

    def hold(route):
        # Record the options that the page sends; the first request waits until it is released.
        sent.append(json.loads(route.request.post_data))
        held.append(route)
        if len(sent) > 1:
            route.continue_()

    for name in ("one.csv", "two.csv"):
        app_page.add(write_trials(tmp_path / name))
        page.get_by_text(f"{name}: first of").wait_for()
    id_of_two = app_page.study_id()

    # While the first choice of two.csv is on its way, the user makes a second one, shows one.csv
    # and makes a choice there.
    page.route("**/options", hold)
    page.select_option("#decimal", ",")
    page.select_option("select[data-role=subject]", "answer")
    # The list closes when it is written anew, which may be after the study is shown.
    page.locator("#studies a", has_text="two.csv").wait_for(state="attached")
    page.evaluate("document.querySelector('#studies').open = true")
    page.get_by_role("link", name="one.csv").click()
    page.get_by_text("one.csv: first of").wait_for()
    page.select_option("#decimal", ".")
    assert sent == [{"decimal": ","}]  # the others wait behind it

    first, *_ = held
    first.continue_()
    app_page.settle()
    answers = {"decimal": ",", "columns": {"subject": "answer"}}
    assert server.state(id_of_two)["options"] == answers
    assert len(sent) == 3
    assert app_page.study()["options"] == {"decimal": "."}


def test_a_choice_that_the_server_refuses_is_taken_back_with_the_reason(browser, server, tmp_path):
    app_page = AppPage(browser, server)
    app_page.add(write_trials(tmp_path / "study.csv"))
    page = app_page.page
    page.select_option("#decimal", ".")
    app_page.settle()
    # As if the disk were full when the next choice comes.
    page.route("**/options", lambda route: route.fulfill(status=507, body='{"problem": "full"}'))
    page.select_option("#decimal", ",")
    app_page.settle()
    page.locator("#message", has_text="full.").wait_for()
    page.wait_for_function("document.querySelector('#decimal').value === '.'")
    page.close()


def test_a_column_is_one_question_with_its_values(app_page, tmp_path):
    # Responses are yes, no, later and never. Two of them get a meaning, and the page asks about the
    # others together, naming each once.
    lines = [f"A,0,.3,{word}\n" for word in ("yes", "no", "yes", "later", "never", "later")]
    (tmp_path / "words.csv").write_text("subject,s1,s2,response\n" + "".join(lines))
    app_page.add(tmp_path / "words.csv")
    app_page.enter({"[data-text=yes]": "second", "[data-text=no]": "first"})
    (question,) = app_page.page.locator(".question").all_inner_texts()
    assert [question.count(word) for word in ("'later'", "'never'", "allowed")] == [1, 1, 1]


def test_all_studies_that_are_not_analysed_are_deleted_together(app_page):
    # The page gets a list of three studies, of which a and b were never run.
    questions = []
    deleted = []
    page = app_page.page
    studies = []
    for name, run in (("a.csv", "new"), ("b.csv", "new"), ("c.csv", "changed")):
        studies.append({"id": name[0], "files": [name], "run": run, "created": "2026-01-01"})
    page.route("**/api/jobs", lambda route: route.fulfill(json={"jobs": studies, "damaged": []}))

    def delete(route):
        deleted.append(urlsplit(route.request.url).path)
        route.fulfill(json={})

    page.route("**/delete", delete)
    page.on("dialog", lambda dialog: (questions.append(dialog.message), dialog.accept()))
    page.reload()
    page.click("#clear")
    page.locator("#start-title:focus").wait_for()
    assert questions == ["Delete 2 studies that are not analysed?"]
    assert deleted == ["/api/jobs/a/delete", "/api/jobs/b/delete"]


#: Pairs of neighbours in both orders.
RATIOS = (1.0, 1.3), (1.3, 1.0), (1.3, 1.69), (1.69, 1.3)


def text_of_trials(header, line, pairs=RATIOS, words=("first", "second")):
    """A file with 20 trials of each pair, four of five of them right.

    `line` is a row: {a} and {b} are the stimuli, {answer} is the word for the stronger one.
    """
    lines = [header]
    for (a, b), trial in product(pairs, range(20)):
        is_right = trial % 5 > 0
        called_second = (b > a) == is_right
        answer = words[called_second]
        other = words[not called_second]
        lines.append(line.format(a=a, b=b, answer=answer, other=other, correct=int(is_right)))
    return "\n".join(lines) + "\n"


OWN_FILE = text_of_trials("s1,s2,response", "{a},{b},{answer}")
LEVELS_DB = (70, 73), (73, 70), (73, 77), (77, 73)
STANDARD = (100, 130), (100, 77)
#: The files of each case below.
FILES_BY_TITLE = {
    "decibels in an encoding": [
        text_of_trials("subject,s1,s2,Antwort,Gerät", "1,{a},{b},{answer},ä", pairs=LEVELS_DB)
    ],
    "intensities": [text_of_trials("vp,A (g),B (g),key", "1,{a},{b},{answer}", words="fj")],
    "unit in the names": [text_of_trials("subject,w1_g,w2_g,response", "1,{a},{b},{answer}")],
    "standard in a unit": [
        text_of_trials(
            "subject,rate,standard,comparison,came,response",
            "1,{b},{a},{b},1,{answer}",
            pairs=STANDARD,
            words=("standard", "comparison"),
        )
    ],
    "right or wrong": [text_of_trials("subject,s1,s2,acc", "1,{a},{b},{correct}")],
    "found by the program": [
        text_of_trials(
            "subject,dur1,dur2,answer", "1,{a},{b},{answer}", pairs=[(400, 500), (500, 400)]
        )
    ],
    "names of files": [OWN_FILE, OWN_FILE],
    "counts": ["subject,s1,s2,alike,n,part\n1,0,0,40,50,x\n1,0,.3,20,50,x\n1,.3,0,9,50,y\n"],
    "pairs in names of columns": [
        "subject,hand,100_112,112_100\nA,left,second,first\nA,right,second,second\n"
    ],
    "blocks": [
        text_of_trials(
            "subject,block,condition,s1,s2,response",
            "1,1,left,{a},{b},{answer}\n1,2,right,{a},{b},{other}",
        )
    ],
}
#: Each case: what is chosen or typed in fields of the page, and the options that follow.
FIELDS_AND_OPTIONS = """
decibels in an encoding
    #encoding = mac_roman
    #scale = dB
--encoding mac_roman --unit dB

intensities
    #stimuli-kind = intensity
    #first = A (g)
    #second = B (g)
    [data-role=response] = key
    [data-text=j] = second
--columns 'i1=A (g),i2=B (g),response=key' --intensity 1 --second-code j

unit in the names
    #stimuli-kind = log
--columns s1=w1_g,s2=w2_g --unit ln

standard in a unit
    #stimuli-kind = standard_intensity
    #standard-order = came
    #unit = um
--standard-interval came --unit um

found by the program
--columns s1=dur1,s2=dur2 --unit ms

right or wrong
    #responses-kind = correct
    #correct = acc
--correct acc

names of files
    [data-role=subject] = *file
--subject-from {}.csv

counts
    #responses-kind = n_equal
    [data-role=n_equal] = alike
    [data-role=n_trials] = n
    #where-column = part
    #where-text = x
--columns n_equal=alike,n_trials=n --where part=x

pairs in names of columns
    #stimuli-kind = intensity
    [data-role=condition] = hand
    #unit = g
    #reference = right
    #wide = {first}_{second}
--wide {first}_{second} --unit g --condition hand --reference right

blocks
    [data-role=condition] =
    #decisions [data-target='1:2'] = swap
--ignore condition --swap 1:2
"""


@pytest.mark.parametrize(
    "case", FIELDS_AND_OPTIONS.strip().split("\n\n"), ids=lambda case: case.partition("\n")[0]
)
def test_fields_become_the_options_of_the_command(app_page, tmp_path, case):
    # A case is a title, lines such as '#unit = g' (a field of the page, and what is chosen or
    # typed there), and the options of the command. FILES_BY_TITLE has the texts of its files.
    title, *lines, options = case.splitlines()
    for i, text in enumerate(FILES_BY_TITLE[title]):
        (tmp_path / f"{i}.csv").write_text(text, encoding="mac_roman")
    fields = {}
    for line in lines:
        selector, value = line.split(" =")
        fields[selector.strip()] = value.strip()

    app_page.add(*tmp_path.iterdir())
    page = app_page.page
    page.click("#others summary")
    app_page.enter(fields)
    assert page.locator(".question:not(.decision)").all_inner_texts() == []
    # The options follow the seed, in any order.
    _, _, typed = app_page.study()["command"].partition("--seed")
    assert sorted(shlex.split(typed)[1:]) == sorted(shlex.split(options))
    # When the page is loaded again, its fields have the same values.
    page.reload()
    page.locator("#go:enabled").wait_for()
    assert {name: page.input_value(name) for name in fields} == fields


@pytest.mark.parametrize("width, scheme", [(1200, "light"), (400, "dark")])
def test_the_page_is_never_wider_than_its_window(browser, server, tmp_path, width, scheme):
    # The name of the file is long. The page is no wider than its window, at first and with all
    # parts open. It is white, or nearly black where the user prefers dark pages.
    app_page = AppPage(browser, server, width, color_scheme=scheme)
    app_page.add(write_trials(tmp_path / f"{'a_long_name_of_a_study_' * 2}{scheme}.csv"))
    assert app_page.page_width() <= width
    for button in ("[data-field=stimuli] button", "[data-field=meaning] button"):
        app_page.page.locator(button, has_text="second").click()
        app_page.settle()
    app_page.page.locator("#others summary").click()
    assert app_page.page_width() <= width
    colour = app_page.page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert colour == {"light": "rgb(255, 255, 255)", "dark": "rgb(23, 24, 27)"}[scheme]
    app_page.close()
