"use strict";
// Makes a report that is whole without it easier to use: tables sort, subjects are filtered, links open what is folded.
(() => {
  const all = (what, within = document) => [...within.querySelectorAll(what)];

  const value = (row, column) => row.cells[column].dataset.value ?? row.cells[column].textContent.trim();
  const missing = text => text === "" || text === "–";
  const compare = (a, b) => (isNaN(a) || isNaN(b) ? a.localeCompare(b, undefined, { numeric: true }) : a - b);

  /** Rows in the order of a column; what has no value stays last, either way. */
  const sort = (table, column, down) => {
    const rows = all("tr", table.tBodies[0]).map(row => [row, value(row, column)]);
    rows.sort(([, a], [, b]) => missing(a) - missing(b) || (missing(a) ? 0 : down ? compare(b, a) : compare(a, b)));
    table.tBodies[0].append(...rows.map(([row]) => row));
  };

  for (const table of all("table.sortable")) {
    table.classList.add("sorts");
    const heads = [...[...table.tHead.rows].at(-1).cells];
    heads.forEach((head, column) => {
      const button = Object.assign(document.createElement("button"), { type: "button", textContent: "↕" });
      button.setAttribute("aria-label", `sort by ${head.textContent.trim()}`);
      head.append(button);
      head.addEventListener("click", event => {
        const down = head.getAttribute("aria-sort") === "ascending";
        for (const other of heads) {
          other.removeAttribute("aria-sort");
          other.querySelector("button").textContent = "↕";
        }
        head.setAttribute("aria-sort", down ? "descending" : "ascending");
        button.textContent = down ? "↓" : "↑";
        sort(table, column, down);
      });
    });
  }

  const form = document.getElementById("filter");
  const filter = () => {
    const text = form.text.value.trim().toLowerCase(), flagged = form.flagged.checked;
    for (const one of all("[data-subject]")) {
      one.hidden = !one.dataset.subject.toLowerCase().includes(text) || (flagged && !("flagged" in one.dataset));
    }
    const rows = all("#overview-table tr[data-subject]");
    form.shown.value = `${rows.filter(row => !row.hidden).length} of ${rows.length} shown`;
  };
  if (form) {
    form.hidden = false;
    form.addEventListener("input", filter);
    form.addEventListener("submit", event => event.preventDefault());
    filter();
  }

  const folded = all("details.subject"), every = document.getElementById("every");
  if (every) {
    every.hidden = false;
    every.addEventListener("click", () => {
      const open = folded.some(one => !one.open);
      for (const one of folded) one.open = open;
      every.textContent = open ? "close all" : "open all";
    });
  }

  /** Open what the address points into. */
  const reveal = () => {
    const target = document.getElementById(decodeURIComponent(location.hash.slice(1)));
    for (let one = target; one; one = one.parentElement) if (one.tagName === "DETAILS") one.open = true;
    if (target) target.scrollIntoView();
  };
  addEventListener("hashchange", reveal);
  document.addEventListener("click", event => {
    const hash = event.target.closest("a")?.hash;
    if (hash && hash === location.hash) setTimeout(reveal);
  });
  if (location.hash) reveal();
})();
