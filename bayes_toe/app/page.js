"use strict";
// The page of `bayes-toe app`. The server reads and analyses; texts of files are set as text only.

const LARGEST = 64 * 2 ** 20; // bytes, as in server.py
const MOST_PAIRS = 200;
const MOST_NAMES = 5;
const TEXTS = ["reference", "sheet", "encoding", "wide"];
const OPTIONAL = ["condition", "session", "block", "trial"];
const STIMULI = {
  log: ["s1", "s2"], intensity: ["i1", "i2"],
  standard: ["standard", "comparison"], standard_intensity: ["standard", "comparison"],
};
const LOG_UNITS = ["ln", "log10", "dB", "dB-power"];
const ROLES = {
  subject: "subject", s1: "first stimulus", s2: "second stimulus", i1: "first stimulus", i2: "second stimulus",
  standard: "standard", comparison: "comparison", response: "response", correct: "right or wrong",
  n_second: "number of 'second'", n_equal: "number of 'equal'", n_trials: "number of trials",
  condition: "condition", session: "session", block: "block",
  trial: "number of the trial",
};
const MEANINGS = {
  second: "the second was stronger", first: "the first was stronger", equal: "equal", different: "different",
  comparison: "the comparison was stronger",
};
const FIELDS = {
  "--columns": "the columns", "--where": "'Only rows with'", "--ignore": "'none'", "--correct": "'right or wrong'",
  "--subject-from": "'the name of the file'", "--condition": "'Condition'", "--decimal": "'Decimal sign'", "--intensity": "'Intensity whose logarithm is 0'", "--unit": "'The stimuli are'", "--sheet": "'Sheet of the Excel file'", "--encoding": "'Encoding of the text'",
  "--standard-interval": "'The standard was first'", "--comparison-interval": "'The standard was first'", "--standard-first": "'The standard was first'",
};
const FIELD_OF_OPTION = {
  equal_code: "meaning", second_code: "meaning", comparison_code: "meaning", correct: "meaning",
  decimal: "stimuli", intensity: "stimuli", unit: "stimuli", standard_interval: "stimuli",
  comparison_interval: "stimuli", standard_first: "stimuli", standard_first_code: "stimuli", subject_from: "subject",
};
// Options that the form shows, without those that only some of its fields show.
const IN_FORM = [
  ...TEXTS, "columns", "ignore", "where", "subject_from", "condition", "unit", "intensity", "decimal", "correct",
  "standard_first", "standard_interval", "comparison_interval",
];
const STATES = { new: "not analysed", changed: "analysed with other options", running: "is analysed now", stopped: "stopped", done: "results" };

const $ = (selector) => document.querySelector(selector);
const $$ = (selector) => [...document.querySelectorAll(selector)];
let job = null;
const waiting = new Map(); // options that are not sent yet, by study
let isSending = false;
let kinds = {}; // what was chosen of stimuli and responses, which options may not show yet
let timer = 0;

function element(name, text = "", attributes = {}) {
  const made = document.createElement(name);
  made.textContent = text;
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  return made;
}

function capital(text) { return text[0].toUpperCase() + text.slice(1); }

function say(text) { $("#message").textContent = text; }

// --- the server ----------------------------------------------------------------------------------

async function ask(address, body) {
  const options = body === undefined ? {} : { method: "POST", body, headers: { "X-Bayes-Toe": "1" } };
  let answer;
  try {
    answer = await fetch(address, options);
  } catch {
    throw new Error("The program does not answer. Start `bayes-toe app` again, and open the address that it prints.");
  }
  const content = await answer.json().catch(() => ({ problem: "The program gave no answer." }));
  if (!answer.ok) throw new Error(`${content.problem}.`.replace("..", "."));
  return content;
}

async function attempt(work) {
  try {
    await work();
    return true;
  } catch (error) {
    say(error.message);
    return false;
  }
}

const address = (action = "") => `api/jobs/${job.id}${action}`;

// --- 1. the file ---------------------------------------------------------------------------------

async function upload(files) {
  if (!files.length) return;
  let size = 0;
  const body = new FormData();
  for (const file of files) {
    size += file.size;
    body.append("files", file, file.name);
  }
  if (size > LARGEST - 2 ** 16) {
    say("The page takes files of at most 64 MB. Use `bayes-toe run` for larger ones.");
    return;
  }
  say("");
  $("#busy").textContent = "The file is being read ...";
  await attempt(async () => {
    const made = await ask("api/jobs", body);
    if ($(`#studies a[href="#${made.id}"]`)) say("The same file is here already. This is its study.");
    kinds = {};
    location.hash = made.id;
    show(made);
    await list();
    $("#reading-title").focus();
  });
  $("#busy").textContent = "";
  $("#files").value = "";
}

async function list() {
  const { jobs, damaged } = await ask("api/jobs");
  $("#studies").hidden = !jobs.length && !damaged.length;
  $("#studies").open = !job;
  $("#damaged").textContent = damaged.length ? `Not listed, since they hold no study or a damaged one: ${damaged.join(", ")}` : "";
  const unused = jobs.filter(({ run }) => run === "new");
  $("#clear").hidden = unused.length < 2;
  $("#clear").onclick = () => remove(unused, `Delete ${unused.length} studies that are not analysed?`);
  $("#studies tbody").replaceChildren(...jobs.map((one) => {
    const row = element("tr");
    const name = element("td");
    name.append(element("a", fileNames(one.files), { href: `#${one.id}` }));
    const button = element("button", "Delete", { type: "button", "aria-label": `Delete ${fileNames(one.files)}` });
    button.addEventListener("click", () => remove([one], `Delete ${fileNames(one.files)} with its results?`));
    const last = element("td");
    last.append(button);
    const added = new Date(one.created).toLocaleString([], { dateStyle: "medium", timeStyle: "short" });
    row.append(name, element("td", added, { class: "added" }), element("td", STATES[one.run]), last);
    return row;
  }));
}

async function remove(studies, text) {
  if (!confirm(text)) return;
  await attempt(async () => {
    for (const { id } of studies) await ask(`api/jobs/${id}/delete`, "");
  });
  if (studies.some(({ id }) => job?.id === id)) location.hash = "";
  await attempt(list);
  $("#start-title").focus();
}

function fileNames(files) {
  return files.length > 1 ? `${files[0]} and ${files.length - 1} more` : files[0];
}

// --- 2. how it is read ---------------------------------------------------------------------------

function fill(select, names, first) {
  const key = JSON.stringify([names, first]);
  if (select.dataset.names === key) return;
  select.dataset.names = key;
  select.replaceChildren(...first.map(([value, text]) => element("option", text, { value })),
    ...names.map((name) => element("option", name, { value: name })));
}

function choose(select, value) {
  select.value = value ?? "";
  if (select.selectedIndex < 0) select.value = "";
}

// The unit that is chosen, or else that in the names of the columns.
const unitOf = (options) => options.unit ?? ("intensity" in options ? null : job.reading.table?.unit);

function stimuliKind(options) {
  if (kinds.stimuli) return kinds.stimuli;
  const unit = unitOf(options);
  const isRaw = "intensity" in options || (unit && !LOG_UNITS.includes(unit));
  if (orderOf(options)) return isRaw ? "standard_intensity" : "standard";
  return isRaw ? "intensity" : "log";
}

const hasStandard = (stimuli) => stimuli.startsWith("standard");
const hasIntensities = (stimuli) => stimuli.endsWith("intensity");

// Options, with a column that says itself which stimulus came first.
const withOrder = (options) => ({ ...job.reading.table?.order, ...options });

// What says when the standard was first.
function orderOf(options) {
  if (options.standard_first) return "*always";
  const { comparison_interval, standard_interval } = withOrder(options);
  return comparison_interval ? "*comparison" : standard_interval ?? "";
}

// Columns with two values may say when the standard was first, and so may those that are always 1 or 2.
function fillOrder(options) {
  const { names, texts } = job.reading.table;
  const first = [["", "choose"], ["*always", "in all trials"]];
  if (options.comparison_interval) first.push(["*comparison", `as column ${options.comparison_interval} says of the comparison`]);
  for (const name of names) {
    const values = (texts[name] ?? []).map(([text]) => text).filter(Boolean);
    const mayBe = values.length === 2 || ["1", "2"].includes(values.join());
    if (mayBe || name === options.standard_interval) first.push([name, `as column ${name} says: ${values.join(", ")}`]);
  }
  fill($("#standard-order"), [], first);
  choose($("#standard-order"), orderOf(options));
}

function responsesKind(options, roles) {
  if (kinds.responses) return kinds.responses;
  if (options.correct) return "correct";
  if (roles.response || !roles.n_trials) return "response";
  return roles.n_second ? "n_second" : "n_equal";
}

function showForm() {
  const { options, reading } = job;
  const table = reading.table;
  $("#form").hidden = !table;
  if (!table) return;
  const { names, roles } = table;
  const required = [["", "choose a column"]];
  const none = [["", "none"]];
  for (const select of $$("select[data-role]")) {
    const role = select.dataset.role;
    const isOptional = OPTIONAL.includes(role);
    const first = role === "subject" ? [...required, ["*file", "the name of the file"]] : required;
    fill(select, names, isOptional ? none : first);
    const ignored = (options.ignore ?? []).includes(role);
    choose(select, ignored ? "" : roles[role]);
  }
  if (options.subject_from) $("select[data-role=subject]").value = "*file";
  if (options.condition) choose($("select[data-role=condition]"), options.condition);

  const stimuli = stimuliKind(options);
  $("#stimuli-kind").value = stimuli;
  const [first, second] = STIMULI[stimuli];
  for (const [selector, role] of [["#first", first], ["#second", second]]) {
    const select = $(selector);
    const chosen = select.value;
    fill(select, names, required);
    choose(select, roles[role] ?? (kinds.stimuli ? chosen : ""));
    $(`${selector}-label`).textContent = capital(ROLES[role]);
  }
  const isRaw = hasIntensities(stimuli);
  for (const label of ["#reference-label", "#unit-label"]) $(label).hidden = !isRaw;
  if (document.activeElement !== $("#unit")) $("#unit").value = isRaw ? unitOf(options) ?? "" : "";
  $("#scale-label").hidden = isRaw;
  choose($("#scale"), unitOf(options));
  if (document.activeElement !== $("#intensity")) $("#intensity").value = options.intensity ?? "1";
  $("#order-label").hidden = !hasStandard(stimuli);
  fillOrder(withOrder(options));
  choose($("#decimal"), options.decimal);

  const responses = responsesKind(options, roles);
  $("#responses-kind").value = responses;
  for (const label of $$("[data-kind]")) label.hidden = !label.dataset.kind.split(" ").includes(responses);
  fill($("#correct"), names, required);
  choose($("#correct"), options.correct);
  showMeanings(responses, stimuli);

  $("#sheet-label").hidden = !/\.xls[xm]$/i.test(job.files[0]);
  $("#encoding-label").hidden = /\.(xls[xm]|mat)$/i.test(job.files[0]);
  for (const name of TEXTS) {
    if (document.activeElement !== $(`#${name}`)) $(`#${name}`).value = options[name] ?? "";
  }
  fill($("#where-column"), names, none);
  const [column, text] = Object.entries(options.where ?? {})[0] ?? [kinds.where ?? "", ""];
  choose($("#where-column"), column);
  $("#where-text").disabled = !column;
  if (document.activeElement !== $("#where-text")) $("#where-text").value = text;
}

function showMeanings(responses, stimuli) {
  const { options, reading } = job;
  const texts = reading.table.texts[reading.table.roles.response] ?? [];
  $("#meanings").hidden = responses !== "response" || !texts.length;
  const total = texts.reduce((sum, [, count]) => sum + count, 0);
  const key = JSON.stringify([texts, stimuli]);
  const body = $("#meanings tbody");
  if (body.dataset.key !== key) {
    body.dataset.key = key;
    const choices = Object.entries(MEANINGS).filter(([meaning]) => meaning !== "comparison" || hasStandard(stimuli));
    body.replaceChildren(...texts.map(([text, count]) => {
      const select = element("select", "", { "data-text": text, "aria-label": `Meaning of ${text || "an empty cell"}` });
      fill(select, [], [["", "automatic"], ...choices]);
      const row = element("tr");
      const cell = element("td");
      cell.append(select);
      row.append(element("td", text || "(empty)"), element("td", `${count} (${Math.round((100 * count) / total)} %)`), cell);
      return row;
    }));
  }
  for (const select of body.querySelectorAll("select")) {
    const given = Object.keys(MEANINGS).find((meaning) => options[`${meaning}_code`] === select.dataset.text);
    choose(select, given);
  }
}

// Options that no field shows stay as they are.
function optionsWithoutField(stimuli, responses) {
  const { swap, exclude, ...options } = job.options;
  for (const name of IN_FORM) delete options[name];
  const hasMeanings = !$("#meanings").hidden;
  for (const meaning of Object.keys(MEANINGS)) {
    if (hasMeanings || responses !== "response") delete options[`${meaning}_code`];
  }
  if (!hasStandard(stimuli)) delete options.comparison_code;
  if (!hasStandard(stimuli) || $("#standard-order").value !== orderOf(job.options)) delete options.standard_first_code;
  if (!job.reading.study && !$("#decisions").children.length) Object.assign(options, swap && { swap }, exclude && { exclude });
  return options;
}

function collect() {
  const { automatic, unit: unitInNames } = job.reading.table;
  const stimuli = $("#stimuli-kind").value;
  const responses = $("#responses-kind").value;
  const options = optionsWithoutField(stimuli, responses);
  const columns = {};
  const ignore = (job.options.ignore ?? []).filter((role) => !OPTIONAL.includes(role));
  const name = (role, value) => {
    if (value && value !== role && value !== automatic[role]) columns[role] = value;
  };
  const subject = $("select[data-role=subject]").value;
  if (subject === "*file") options.subject_from = `{}${job.files[0].match(/\.[^.]*$/)[0]}`;
  else name("subject", subject);

  name(STIMULI[stimuli][0], $("#first").value);
  name(STIMULI[stimuli][1], $("#second").value);
  const isRaw = hasIntensities(stimuli);
  // Without 'ln' the unit in the names would be read again.
  const scale = $("#scale").value || (unitInNames ? "ln" : "");
  const unit = isRaw ? $("#unit").value.trim() : scale;
  const reference = $("#intensity").value.replace(",", ".") || "1";
  if (unit && (unit !== unitInNames || reference !== "1")) options.unit = unit;
  if (isRaw && (!unit || reference !== "1")) options.intensity = reference;
  const order = hasStandard(stimuli) ? $("#standard-order").value : "";
  if (order === "*always") options.standard_first = true;
  else if (order === "*comparison") options.comparison_interval = withOrder(job.options).comparison_interval;
  else if (order) options.standard_interval = order;
  if ($("#decimal").value) options.decimal = $("#decimal").value;

  if (responses === "correct") {
    if ($("#correct").value) options.correct = $("#correct").value;
  } else if (responses === "response") {
    name("response", $("select[data-role=response]").value);
    for (const select of $$("#meanings select")) {
      if (select.value) options[`${select.value}_code`] = select.dataset.text;
    }
  } else {
    name(responses, $(`select[data-role=${responses}]`).value);
    name("n_trials", $("select[data-role=n_trials]").value);
  }
  if (!order) delete options.comparison_code;

  for (const role of OPTIONAL) {
    const value = $(`select[data-role=${role}]`).value;
    if (!value && role in automatic) ignore.push(role);
    else if (role === "condition" && value && value !== role) options.condition = value;
    else name(role, value);
  }
  if (ignore.length) options.ignore = ignore;
  for (const name of TEXTS) if ($(`#${name}`).value) options[name] = $(`#${name}`).value;
  const column = $("#where-column").value;
  const [, ...otherRows] = Object.entries(job.options.where ?? {});
  if (column && $("#where-text").value) options.where = { [column]: $("#where-text").value, ...Object.fromEntries(otherRows) };
  for (const select of $$("#decisions select")) {
    if (select.value) (options[select.value] ??= []).push(select.dataset.target);
  }
  if (Object.keys(columns).length) options.columns = columns;
  return options;
}

// The page shows an answer at once, so that the next one has it too.
async function send(options) {
  const { table } = job.reading;
  const roles = { ...table?.automatic, ...options.columns };
  job = { ...job, options, reading: { ...job.reading, table: table && { ...table, roles } } };
  showForm();
  waiting.set(job.id, options);
  if (isSending) return;
  isSending = true;
  $("#busy").textContent = "The file is being read ...";
  showRun();
  say("");
  let state;
  while (waiting.size) {
    const [[id, next]] = waiting;
    waiting.delete(id);
    await attempt(async () => { state = await ask(`api/jobs/${id}/options`, JSON.stringify(next)); });
  }
  isSending = false;
  $("#busy").textContent = "";
  showRun();
  if (state?.id === job?.id) show(state);
  else await refresh();
}

function plainWords(text) {
  let words = text;
  for (const file of job.files) words = words.replace(new RegExp(`^${file.replace(/[.*+?^${}()|[\]\\]/g, "\\$&")}: `), "");
  return words.replace(/--[a-z]+-code(, --[a-z]+-code)*/g, "'Meaning of each response'").replace(/^row 1(, |: )(?=column|there|the)/, "").replace(/--[a-z-]+( [A-Z=]+)?/g, (option) => {
    return FIELDS[option.split(" ")[0]] ?? option;
  });
}

// The part of the form at which a problem stands; '' is above the form.
function fieldOf(problem, remedies) {
  for (const { option, value } of remedies) {
    const field = option === "columns" ? fieldOfRole(value[0][0]) : FIELD_OF_OPTION[option];
    if (field) return field;
  }
  const { standard_interval, comparison_interval, correct } = job.options;
  const named = { standard_interval, comparison_interval, response: correct };
  const roles = Object.entries({ ...named, ...job.reading.table?.roles });
  const about = roles.find(([, name]) => problem.includes(`column ${name}:`));
  return about ? fieldOfRole(about[0]) : "";
}

function fieldOfRole(role) {
  if (role === "response") return "meaning";
  if (role.startsWith("n_")) return "responses";
  if (role === "subject") return "subject";
  return OPTIONAL.includes(role) ? "others" : "stimuli";
}

function questionText(text, remedies) {
  const stimuli = stimuliKind(job.options);
  const hasNoOrder = hasStandard(stimuli) && !orderOf(job.options);
  if (hasNoOrder && fieldOf(text, remedies) === "stimuli") return "Choose when the standard was first.";
  if (remedies.some(({ option }) => option.startsWith("standard"))) {
    return "The columns do not say which stimulus came first, without which no order effect can be seen.";
  }
  const columns = remedies.find((remedy) => remedy.option === "columns");
  if (!columns) return capital(plainWords(text));
  return `Choose the column of: ${columns.value.map(([role]) => ROLES[role]).join(", ")}.`;
}

function remedyText({ option, value, meaning }) {
  const code = option.match(/^(equal|different|second|first|comparison)_code$/);
  if (code) return `${value} means: ${MEANINGS[code[1]]}`;
  if (option === "columns") return value.filter(isNamed).map(([role, name]) => `${ROLES[role]}: ${name}`).join(", ");
  const texts = {
    sheet: `sheet ${value}`,
    correct: `column ${value} says right or wrong`,
    missed: `${value} means: nobody responded`,
    unit: LOG_UNITS.includes(value) ? meaning.replace(/^if /, "") : `they are intensities in ${value}`,
    standard_interval: `column ${value} says when the standard came`,
    comparison_interval: `column ${value} says when the comparison came`,
    standard_first: "the standard was first in all trials",
    subject_from: "the name of the file is the subject",
  };
  return texts[option] ?? meaning.replace(/^if /, "");
}

// Intensities of this unit; the columns of the logarithms become theirs.
function toIntensities(options, unit) {
  const isStandard = hasStandard(stimuliKind(options));
  kinds = { ...kinds, stimuli: isStandard ? "standard_intensity" : "intensity" };
  options.unit = unit;
  if (isStandard) return;
  const { s1, s2, ...others } = options.columns ?? {};
  const { roles } = job.reading.table;
  options.columns = { ...others, i1: s1 ?? roles.s1 ?? roles.i1, i2: s2 ?? roles.s2 ?? roles.i2 };
}

const isNamed = ([, name]) => name !== "NAME";

function isComplete({ option, value }) {
  if (Array.isArray(value)) return value.some(isNamed);
  return value !== "NAME" && !(option === "subject_from" && job.files.length < 2);
}

function apply({ option, value }) {
  const options = job.reading.table ? collect() : { ...job.options };
  if (option === "correct" || option.includes("standard") || option.endsWith("interval")) kinds = {};
  if (option === "missed") options.missed = [...(options.missed ?? []), value];
  else if (Array.isArray(value)) options[option] = { ...options[option], ...Object.fromEntries(value.filter(isNamed)) };
  else if (option === "unit" && !LOG_UNITS.includes(value)) toIntensities(options, value);
  else options[option] = value || true;
  if (option === "correct") for (const meaning of Object.keys(MEANINGS)) delete options[`${meaning}_code`];
  send(options);
}

function question(text, remedies, lines = []) {
  const box = element("div", "", { class: "question" });
  const listing = element("ul");
  listing.append(...lines.map((line) => element("li", line)));
  box.append(element("p", text), listing);
  listing.hidden = !lines.length;
  for (const remedy of remedies) {
    const button = element("button", remedyText(remedy), { type: "button" });
    button.addEventListener("click", () => {
      apply(remedy);
      if (remedy.option === "unit" && hasIntensities(stimuliKind(job.options))) $("#unit").focus();
    });
    box.append(button);
  }
  return box;
}

// Problems of one column are one question, with a line a value.
function groupedProblems() {
  const { problems, remedies } = job.reading;
  const groups = [];
  for (const [i, problem] of problems.entries()) {
    const own = remedies.filter((remedy) => (remedy.question ?? 0) === i);
    const parts = plainWords(problem).match(/^(row [\d,]+, )?(column .+?): (found .*?)(?:, allowed: (.*))?$/) ?? [];
    const [, row = "", column, finding, allowed] = parts;
    const isMore = problem.startsWith("... and") && groups.length > 0;
    const group = isMore ? groups.at(-1) : groups.find((other) => column && other.column === column && other.allowed === allowed);
    if (group && !own.length) group.lines.push(isMore ? problem : `${row}${finding}`);
    else groups.push({ problem, remedies: own, column, allowed, lines: [`${row}${finding}`] });
  }
  return groups;
}

function showQuestions() {
  const boxes = Object.fromEntries($$(".questions").map((box) => [box.dataset.field, []]));
  for (const { problem, remedies, column, allowed, lines } of groupedProblems()) {
    const field = fieldOf(problem, remedies);
    const isList = lines.length > 1 && column;
    const text = isList ? `${capital(column)}${allowed ? `, allowed: ${allowed}` : ""}` : questionText(problem, remedies);
    boxes[field].push(question(text, remedies.filter(isComplete), isList ? lines : lines.slice(1)));
    if (field === "others") $("#others").open = true;
  }
  for (const box of $$(".questions")) box.replaceChildren(...boxes[box.dataset.field]);
}

function showTable() {
  const table = job.reading.table;
  $("#rows").parentElement.hidden = !table;
  if (!table) return;
  const roleOf = Object.fromEntries(Object.entries(table.roles).map(([role, name]) => [name, ROLES[role]]));
  $("#rows caption").textContent = `${fileNames(job.files)}: first of ${table.size.toLocaleString("en")} rows`;
  const head = element("tr");
  for (const name of table.names) {
    const cell = element("th", name);
    cell.append(element("small", roleOf[name] ?? ""));
    head.append(cell);
  }
  $("#rows thead").replaceChildren(head);
  $("#rows tbody").replaceChildren(...table.rows.map((cells) => {
    const row = element("tr");
    row.append(...cells.map((cell) => element("td", cell)));
    return row;
  }));
}

function showStudy() {
  const study = job.reading.study;
  $("#study").hidden = !study;
  if (!study) {
    if (!job.options.swap && !job.options.exclude) $("#decisions").replaceChildren();
    return;
  }
  const task = study.answer === "equal" ? "same or different" : "which was stronger (2AFC)";
  $("#summary").textContent = `Read: ${study.subjects} ${study.subjects === 1 ? "subject" : "subjects"}${study.units > study.subjects ? " in several conditions" : ""}, ${study.trials.toLocaleString("en")} trials, ${task}. ${capital(study.notes[0])}.`;
  const head = element("tr");
  const isRaw = hasIntensities(stimuliKind(job.options));
  const ln = study.unit || isRaw ? "" : " (ln)";
  for (const text of [`first${ln}`, `second${ln}`, "second is stronger by", "trials", `'${study.answer}'`]) {
    head.append(element("th", text, { class: "number" }));
  }
  $("#pairs thead").replaceChildren(head);
  $("#pairs tbody").replaceChildren(...study.pairs.slice(0, MOST_PAIRS).map(([pair, yes, trials], i) => {
    const row = element("tr");
    const reference = isRaw ? Number(job.options.intensity ?? 1) : 1;
    const plain = pair.slice(0, 2).map((value) => number(isRaw ? reference * Math.exp(value) : value));
    const stimuli = [...(study.unit ? study.stimuli[i] : plain), ...pair.slice(2).map(number)];
    const texts = [...stimuli, step(pair[1] - pair[0]), trials.toLocaleString("en"), `${Math.round((100 * yes) / trials)} %`];
    row.append(...texts.map((text) => element("td", text, { class: "number" })));
    return row;
  }));
  const shown = study.pairs.length > MOST_PAIRS ? `, the first ${MOST_PAIRS} of ${study.pairs.length}` : "";
  $("#pairs caption").textContent = `Pairs, all subjects together${shown}`;
  $("#notes").parentElement.hidden = study.notes.length < 2;
  $("#notes").replaceChildren(...study.notes.slice(1).map((note) => element("li", plainWords(note))));
  const open = study.findings.filter((finding) => finding.target);
  const plain = study.findings.filter((finding) => !finding.target);
  const subjectsOf = new Map();
  for (const { subject, message } of plain) subjectsOf.set(message, [...(subjectsOf.get(message) ?? []), subject]);
  $("#findings").replaceChildren(...[...subjectsOf].map(([message, subjects]) => {
    const more = subjects.length > MOST_NAMES ? ` and ${subjects.length - MOST_NAMES} more` : "";
    return element("li", about({ subject: subjects.slice(0, MOST_NAMES).join(", ") + more, message }));
  }));
  $("#decisions").replaceChildren(...open.map((finding) => {
    const box = element("label", "", { class: "question decision" });
    const select = element("select", "", { "data-target": finding.target });
    const choices = [["", "keep as it is"], ["exclude", "exclude"]];
    if (finding.option.startsWith("--swap")) choices.push(["swap", "swap the responses"]);
    fill(select, [], choices);
    choose(select, ["swap", "exclude"].find((way) => (job.options[way] ?? []).includes(finding.target)));
    select.addEventListener("change", () => send(collect()));
    box.append(element("p", about(finding)), select);
    return box;
  }));
}

function number(value) { return String(Number(value.toPrecision(4))).replace("-", "−"); }

// By how much the second stimulus is stronger.
function step(difference) {
  if (!difference) return "equal";
  if (Math.abs(difference) > Math.log(100)) return `a factor of ${Math.exp(difference).toPrecision(3)}`;
  const percent = number(Number((100 * Math.expm1(difference)).toPrecision(3)));
  return `${difference > 0 ? "+" : ""}${percent} %`;
}

function about(finding) {
  return plainWords(finding.subject ? `${finding.subject}: ${finding.message}` : finding.message);
}

// --- 3. the run, 4. the results ------------------------------------------------------------------

function showRun() {
  $("main").setAttribute("aria-busy", isSending);
  $("#run").dataset.state = job.run;
  const { run, reading } = job;
  const study = reading?.study;
  const done = Math.min(job.done, study?.units ?? 0); // comparisons of conditions are stored too
  $("#run").hidden = !reading?.table;
  const isRunning = run === "running";
  $("#go").hidden = isRunning || run === "done";
  $("#stop").hidden = !isRunning;
  $("#go").textContent = run === "stopped" ? "Go on" : "Analyse";
  $("#go").disabled = !study || isSending;
  $("#progress").hidden = ["new", "changed"].includes(run) || !study;
  if (study) {
    $("#progress").max = study.units;
    $("#progress").value = run === "done" ? study.units : done;
  }
  $("#progress-text").textContent = progressText(run, done, study);
  $("#log").hidden = !job.log;
  if (hasFailed()) $("#log").open = true;
  $("#log pre").textContent = job.log;
  for (const field of $$("#form select, #form input, #decisions select")) {
    if (isRunning) field.disabled = true;
    else if (field.id !== "where-text") field.disabled = false;
  }
  for (const button of $$(".question button")) button.disabled = isRunning;
  $("#results").hidden = run !== "done";
  if (run === "done" && $("#report").dataset.job !== job.id) {
    $("#report").dataset.job = job.id;
    const report = `${job.results}report.html`;
    $("#report").src = report;
    $("#open").href = report;
    $("#folder").textContent = job.folder;
    $("#command").textContent = job.command;
  }
}

// A run that is stopped early prints nothing.
function hasFailed() { return job.run === "stopped" && job.log !== "" && !job.log.includes("stopped by"); }

function progressText(run, done, study) {
  if (!study) return isSending ? "" : "Answer the questions above first.";
  const parts = study.units > study.subjects ? "subjects in conditions" : "subjects";
  const of = `${done} of ${study.units} ${parts} ${done === 1 ? "is" : "are"} finished.`;
  if (run === "done") return "The analysis is finished. After a change above, you can analyse again.";
  if (hasFailed()) return "The analysis ended without results. What the program printed says why.";
  if (run === "stopped") return `Stopped. ${of} Go on starts from there.`;
  if (run !== "running") return "A subject takes seconds to a minute.";
  return done < study.units ? of : `${of} The program writes the report.`;
}

function show(state) {
  if (state.id !== location.hash.slice(1)) return; // another study was opened meanwhile
  if (state.id !== job?.id && document.activeElement.closest("#form")) document.activeElement.blur();
  job = state;
  $("#reading").hidden = false;
  $("#start").classList.toggle("short", true);
  showTable();
  showForm();
  showQuestions();
  showStudy();
  showRun();
  clearTimeout(timer);
  if (job.run === "running") timer = setTimeout(refresh, 1000);
}

async function refresh() {
  if (!job || isSending) return;
  const before = job;
  const was = job.run;
  const isFine = await attempt(async () => {
    const state = await ask(address());
    if (job !== before) return; // an answer was given meanwhile
    if (was === "running" && state.run === "running") {
      job = state;
      showRun();
      timer = setTimeout(refresh, 1000);
      return;
    }
    show(state);
    if (was === "running") await list();
    if (was === "running" && state.run === "done") $("#results-title").focus();
  });
  if (!isFine && was === "running") timer = setTimeout(refresh, 3000);
}

async function act(action, focus) {
  say("");
  clearTimeout(timer);
  $("#go").disabled = $("#stop").disabled = true;
  const isFine = await attempt(async () => {
    show(await ask(address(action), ""));
    await list();
  });
  $("#stop").disabled = false;
  if (isFine) $(focus).focus();
  else await refresh();
}

// --- start ---------------------------------------------------------------------------------------

async function openHash() {
  const id = location.hash.slice(1);
  clearTimeout(timer);
  if (job && job.id === id) return;
  say("");
  job = null;
  kinds = {};
  for (const section of ["#reading", "#run", "#results"]) $(section).hidden = true;
  if (/^[0-9a-f]{16}$/.test(id)) await attempt(async () => show(await ask(`api/jobs/${id}`)));
  await attempt(list);
}

function listen() {
  const drop = $("#drop");
  $("#files").addEventListener("change", (event) => upload(event.target.files));
  for (const [type, isOver] of [["dragenter", true], ["dragover", true], ["dragleave", false], ["drop", false]]) {
    document.addEventListener(type, (event) => {
      event.preventDefault();
      drop.classList.toggle("over", isOver);
    });
  }
  document.addEventListener("drop", (event) => upload(event.dataTransfer.files));
  $("#form").addEventListener("submit", (event) => event.preventDefault());
  $("#form").addEventListener("change", (event) => {
    const field = event.target;
    if (field.id === "stimuli-kind") kinds.stimuli = field.value;
    if (field.id === "responses-kind") kinds.responses = field.value;
    if (field.id === "where-column") kinds.where = field.value;
    if (field.dataset.text !== undefined && field.value) {
      for (const other of $$("#meanings select")) if (other !== field && other.value === field.value) other.value = "";
    }
    if (field.id === "where-column") $("#where-text").disabled = !field.value;
    send(collect());
  });
  $("#go").addEventListener("click", () => act("/run", "#stop"));
  $("#stop").addEventListener("click", () => act("/stop", "#go"));
  $("#copy").addEventListener("click", () => navigator.clipboard.writeText(job.command));
  window.addEventListener("hashchange", openHash);
  window.addEventListener("focus", () => { if (job && job.run !== "running") refresh(); });
}

if (location.search) history.replaceState(null, "", `/${location.hash}`);
listen();
openHash();
