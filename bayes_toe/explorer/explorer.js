// What the page does: fill the figures that panels.py made, and follow what is chosen and brushed. Nothing of the model is computed
// here: curves are means and quantiles over rows of values that Python wrote.
"use strict";
window.explorer = (() => {
  const LETTERS = ["a", "b"], KINDS = { "-1": "weaker", "1": "stronger", "0": "equal" };
  const BINS = 30, BAND = [0.025, 0.975], MARKED = [0.025, 0.5, 0.975], FEW = 20, WORDS_LEFT = 64, WORDS_BELOW = 44, AROUND = 3;
  const at = id => document.getElementById(id);
  const island = id => JSON.parse(at(id).textContent);
  const index = island("index");
  const state = { tab: index.tabs[0], a: 0, b: null, names: [], slice: 0, brush: null };
  // Colours of the figures on a dark page; orange and blue are the same on both.
  const DARK = { "#222222": "#E4E4E4", "#777777": "#9A9A9A", "#000000": "#FFFFFF", "#FFFFFF": "#17181B", "#4B3B8F": "#B7A6FF", "#00795C": "#3FCBA2", "#6E6E6E": "#A8A8A8" };
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const decoded = new Map();
  const models = new Map(), painted = new Map();
  let doc = null, waiting = false, fainted = null;

  // --- Numbers -------------------------------------------------------------------------------------------------------------------

  const bytes = text => Uint8Array.from(atob(text), letter => letter.charCodeAt(0)).buffer;
  const floats = text => new Float32Array(bytes(text));
  const range = count => Array.from({ length: count }, (_, i) => i);
  const mean = values => values.reduce((sum, value) => sum + value, 0) / values.length;

  function quantile(ascending, share) {  // linear between draws, as NumPy has it
    const place = share * (ascending.length - 1), low = Math.floor(place);
    const high = Math.min(low + 1, ascending.length - 1);
    return ascending[low] + (place - low) * (ascending[high] - ascending[low]);
  }

  function written(value) {  // three digits, and a minus sign that is one
    const size = Math.abs(value);
    return (size !== 0 && (size < 1e-3 || size >= 1e5) ? value.toExponential(2) : String(Number(value.toPrecision(3)))).replace("-", "−");
  }

  const count = value => value.toLocaleString("en");
  const share = value => value === 0 ? "0 %" : value < 0.01 ? "under 1 %" : value < 1 && value > 0.99 ? "over 99 %" : `${Math.round(100 * value)} %`;

  const probability = value => value < 0.01 ? "below .01" : value > 0.99 ? "above .99" : value.toFixed(2).slice(1);

  // --- Entries: one posterior of one subject -----------------------------------------------------------------------------------------

  function entry(letter) {
    const place = state[letter];
    if (place === null) return null;
    if (!decoded.has(place)) {
      const found = island(`entry-${place}`), values = floats(found.values);
      found.samples = new Map(found.names.map((name, i) => [name, values.subarray(i * found.rows, (i + 1) * found.rows)]));
      for (const slice of found.slices) slice.values = Float32Array.from(new Uint16Array(bytes(slice.yes)), value => value / 65535);
      found.ends2 = floats(found.axis);
      decoded.set(place, found);
    }
    return decoded.get(place);
  }

  const shown = () => LETTERS.filter(letter => state[letter] !== null);
  const symbol = name => index.quantities[name]?.[0] ?? name ?? "";
  const places = () => range(index.entries.length).filter(place => index.entries[place].tab === state.tab);
  const labels = () => [...new Set(places().map(place => index.entries[place].label))];
  const prior = letter => entry(letter)?.prior ?? null;

  // Rows of an entry that lie in the brush; null: nothing is brushed, or the entry lacks a quantity of the brush.
  function rows(found) {
    if (state.brush === null || Object.keys(state.brush.limits).some(name => !found.samples.has(name))) return null;
    const tests = Object.entries(state.brush.limits).map(([name, limits]) => [found.samples.get(name), ...limits]);
    return range(found.rows).filter(row => tests.every(([values, low, high]) => values[row] >= low && values[row] <= high));
  }

  function summary(values, kept) {
    const ascending = Float64Array.from(kept.map(row => values[row])).filter(value => !isNaN(value)).sort();
    return ascending.length === 0 ? null : MARKED.map(one => quantile(ascending, one));
  }

  // --- What the sources of the figures hold ------------------------------------------------------------------------------------------

  function model(name) {
    if (!models.has(name)) models.set(name, doc.get_model_by_name(name));
    return models.get(name);
  }

  const fill = (name, data) => { model(name).data = data; };
  const slots = make => Object.assign({}, ...range(index.slots).map(slot => make(state.names[slot], slot)));
  const has = (found, name) => found !== null && name !== undefined && found.samples.has(name);

  function spans() {
    for (const [slot, name] of state.names.entries()) {
      const found = shown().map(entry).filter(one => has(one, name)).map(one => one.spans[one.names.indexOf(name)]);
      const limits = model(`range-${slot}`);
      limits.setv({ start: Math.min(...found.map(one => one[0])), end: Math.max(...found.map(one => one[1])) });
    }
  }

  // Draws in every panel that is shown: all rows or some, without a number where a model lacks the quantity.
  function drawDraws(which, letter, found, chosen) {
    const length = found === null ? 0 : chosen === null ? found.rows : chosen.length, none = new Float32Array(length).fill(NaN);
    const row = chosen ?? range(length), values = state.names.map(name => {
      if (!has(found, name)) return none;
      const every = found.samples.get(name);
      return chosen === null ? every : Float32Array.from(chosen, one => every[one]);
    });
    for (const y of values.keys()) for (let x = 0; x < y; x++) fill(`${which}-${letter}-${y}-${x}`, { x: values[x], y: values[y], row });
  }

  function drawFaint() {  // all draws, behind those that are selected
    if (fainted === (state.brush !== null)) return;
    fainted = state.brush !== null;
    for (const letter of LETTERS) drawDraws("all", letter, fainted ? entry(letter) : null, null);
  }

  function ticks(low, high, most) {  // round numbers, none so near an end that its label could touch the next panel's
    const margin = 0.09 * (high - low), inside = step => {
      const from = Math.ceil((low + margin) / step), to = Math.floor((high - margin) / step);
      return range(Math.max(0, to - from + 1)).map(k => (from + k) * step);
    };
    const unit = 10 ** Math.ceil(Math.log10(high - low)), steps = [0.01, 0.02, 0.025, 0.05, 0.1, 0.2, 0.25, 0.5, 1].map(share => inside(share * unit));
    return steps.find(found => found.length <= most) ?? [];
  }

  function contours(holder, ...names) {  // lines of the two named quantities, those of a level in one
    const [i, j] = names.map(name => holder === null ? -1 : holder.names.indexOf(name)), lines = { xs: [], ys: [], width: [] };
    if (i < 0 || j < 0) return lines;
    const [left, right] = [Math.min(i, j), Math.max(i, j)], { contours: packed, names: { length: count } } = holder;
    for (const [level, text] of packed[left * count - left * (left + 1) / 2 + right - left - 1].entries()) {
      const numbers = Array.from(floats(text)), half = numbers.length / 2, first = numbers.slice(0, half), second = numbers.slice(half);
      lines.xs.push(i < j ? first : second);
      lines.ys.push(i < j ? second : first);
      lines.width.push(level === 0 ? 2.5 : 1.3);
    }
    return lines;
  }

  function drawContours() {
    for (const [row, y] of state.names.entries()) for (const [column, x] of state.names.slice(0, row).entries()) {
      for (const letter of LETTERS) fill(`contour-${letter}-${row}-${column}`, contours(entry(letter), x, y));
    }
  }

  function heights(values, chosen, low, high) {  // density in bins, as a share of all draws
    const bars = new Float64Array(BINS), scale = BINS / (high - low);
    const add = value => { if (value >= low && value <= high) bars[Math.min(BINS - 1, Math.floor((value - low) * scale))] += scale / values.length; };
    if (chosen === null) values.forEach(add); else chosen.forEach(row => add(values[row]));
    return bars;
  }

  function believed(quantiles, low, high) {  // density in bins from evenly spaced quantiles
    const last = quantiles.length - 1, below = value => {
      if (value <= quantiles[0]) return 0;
      if (value >= quantiles[last]) return 1;
      const right = quantiles.findIndex(one => one > value), left = right - 1;
      return (left + (value - quantiles[left]) / (quantiles[right] - quantiles[left])) / last;
    };
    const edges = range(BINS + 1).map(k => below(low + k * (high - low) / BINS));
    return edges.slice(1).map((value, k) => (value - edges[k]) * BINS / (high - low));
  }

  const steps = bars => Array.from(bars).flatMap(value => [value, value]);

  const limits = slot => [model(`range-${slot}`).start, model(`range-${slot}`).end];
  const edges = slot => { const [low, high] = limits(slot); return range(2 * BINS).map(k => low + Math.ceil(k / 2) * (high - low) / BINS); };
  const none = new Float64Array(2 * BINS).fill(NaN);

  function drawBelieved() {  // the prior on the diagonals
    const density = (holder, name, slot) => {
      const place = holder === null || name === undefined ? -1 : holder.names.indexOf(name);
      if (place < 0) return none;
      const all = floats(holder.prior), length = all.length / holder.names.length, share = holder.priorShares[place];
      return steps(believed(all.subarray(place * length, (place + 1) * length), ...limits(slot)).map(value => value * share));
    };
    const same = prior("b") !== null && prior("a") === prior("b");
    for (const [name, holder] of [["prior-a", entry("a")], ["prior-b", same ? null : entry("b")]]) {
      fill(name, slots((quantity, slot) => ({ [`x${slot}`]: edges(slot), [`y${slot}`]: density(holder, quantity, slot) })));
    }
  }

  function drawDiagonals(kept) {
    const tops = range(index.slots).map(() => 0);
    for (const letter of LETTERS) {
      const found = entry(letter);
      fill(`bars-${letter}`, slots((name, slot) => {
        if (!has(found, name)) return { [`x${slot}`]: edges(slot), [`all${slot}`]: none, [`kept${slot}`]: none };
        const values = found.samples.get(name), all = steps(heights(values, null, ...limits(slot)));
        tops[slot] = Math.max(tops[slot], ...all);
        return { [`x${slot}`]: edges(slot), [`all${slot}`]: all, [`kept${slot}`]: kept[letter] === null ? all : steps(heights(values, kept[letter], ...limits(slot))) };
      }));
    }
    for (const slot of range(index.slots)) model(`height-${slot}`).setv({ start: 0, end: 1.15 * tops[slot] || 1 });
  }

  // --- Answers -------------------------------------------------------------------------------------------------------------------------

  const EMPTY = { x: [], all: [], kept: [], low: [], high: [] };

  // Mean and band over rows of values that stand row after row of one point, points after each other.
  function band(values, length, points, kept) {
    const whole = range(points).map(k => values.subarray(k * length, (k + 1) * length));
    const chosen = kept === null ? whole : whole.map(one => kept.map(row => one[row]));
    const ascending = chosen.map(one => Float64Array.from(one).sort()), nothing = range(points).map(() => NaN);
    const some = kept === null || kept.length > 0;
    return { all: whole.map(one => mean(one)), kept: some ? chosen.map(one => mean(one)) : nothing,
      low: some ? ascending.map(one => quantile(one, BAND[0])) : nothing, high: some ? ascending.map(one => quantile(one, BAND[1])) : nothing };
  }

  const sliced = found => found === null ? null : found.slices[Math.min(state.slice, found.slices.length - 1)];

  function drawAnswers(letter, found) {  // counts, in both figures
    const slice = sliced(found);
    for (const [order, kind] of Object.entries(KINDS)) {
      const p = found?.pairs, of = list => list.filter(pair => p.order[pair] === Number(order));
      const drawn = slice === null ? [] : of(slice.pairs), every = found === null ? [] : of(range(p.s1.length));
      const take = (key, list) => list.map(pair => p[key][pair]);
      fill(`answers-${letter}-${kind}`, { x: take("along", drawn), estimate: take("estimate", drawn), stimuli: take("stimuli", drawn),
        low: drawn.map(pair => p.estimate[pair] - p.error[pair]), high: drawn.map(pair => p.estimate[pair] + p.error[pair]), k: take("k", drawn), n: take("n", drawn) });
      fill(`pairs-${letter}-${kind}`, { s1: take("s1", every), s2: take("s2", every), stimuli: take("stimuli", every), k: take("k", every), n: take("n", every),
        fill: every.map(pair => { const grey = Math.round(255 - 215 * p.k[pair] / p.n[pair]); return `rgb(${grey},${grey},${grey})`; }) });
    }
    if (slice === null) return;
    const pad = 0.04 * (slice.x.at(-1) - slice.low);
    model(`stronger-${letter}`).setv({ start: slice.low - pad, end: slice.x.at(-1) });
    model(`curves-title-${letter}`).text = slice.title;
    model(`plane-${letter}-range`).setv({ start: found.ends[0], end: found.ends[1] });
    const plane = model(`plane-${letter}`), second = found.plane && { ...found.plane, label: found.plane.label.replace("first", "second") };
    scale(model(`curves-${letter}`).below[0], slice.scale, slice.low - pad, slice.x.at(-1));
    scale(plane.below[0], found.plane, ...found.ends);
    scale(plane.left[0], second, ...found.ends);
  }

  function scale(axis, marks, low, high) {  // numbers in the unit of the stimuli if it is known, else natural logs
    axis.ticker.ticks = marks === null ? ticks(low, high, 4) : marks.at;
    if (marks !== null) axis.setv({ axis_label: marks.label, major_label_overrides: new Map(marks.at.map((at, i) => [at, marks.texts[i]])) });
  }

  function drawCurves(letter, found, kept) {
    const slice = sliced(found), points = slice?.x.length, size = found?.rows * points;
    for (const [order, kind] of Object.entries(KINDS)) {
      const place = slice?.values ? slice.orders.indexOf(Number(order)) : -1;
      fill(`curve-${letter}-${kind}`, place < 0 ? EMPTY
        : { x: slice.x, ...band(slice.values.subarray(place * size, (place + 1) * size), found.rows, points, kept) });
    }
  }

  function drawAxis(letter, found, kept) {
    if (found === null) { fill(`axis-${letter}`, EMPTY); return; }
    const points = 21, [low, high] = found.ends, values = new Float64Array(points * found.rows), x = [];
    for (const k of range(points)) {
      const along = k / (points - 1);
      x.push(low + along * (high - low));
      for (let row = 0; row < found.rows; row++) values[k * found.rows + row] = (1 - along) * found.ends2[row] + along * found.ends2[found.rows + row];
    }
    fill(`axis-${letter}`, { x, ...band(values, found.rows, points, kept) });
  }

  // --- Words ---------------------------------------------------------------------------------------------------------------------------

  const element = (tag, text = "", kind = "") => Object.assign(document.createElement(tag), { textContent: text, className: kind });
  const titled = (letter, found) => `${letter.toUpperCase()} ${found.subject}` + (labels().length > 1 ? ` · ${found.label}` : "");

  function sayShare(letter, found, kept) {
    const mark = element("div", "", letter), name = element("b", `${letter.toUpperCase()} ${found.subject}`);
    const all = `${count(found.rows)} of ${count(found.of)} draws are shown`;
    const words = state.brush === null ? all : kept === null ? `does not have the selected quantity: ${all}`
      : kept.length === 0 ? `none of ${count(found.rows)} shown draws is selected` : `${count(kept.length)} of ${count(found.rows)} shown draws are selected (${share(kept.length / found.rows)})`;
    mark.append(name, `: ${words}` + (kept !== null && kept.length > 0 && kept.length < FEW ? ": too few" : ""));
    return mark;
  }

  const having = (found, name) => has(found, name) ? found.with[found.names.indexOf(name)] / found.of : 1;  // share of the draws

  function cells(found, name, kept) {
    const fill = (cell, [low, middle, high]) => cell.append(element("b", written(middle)), element("small", ` [${written(low)}, ${written(high)}]`));
    const all = element("td"), some = element("td"), chosen = kept === null ? null : summary(found.samples.get(name), kept);
    fill(all, found.marked[found.names.indexOf(name)]);
    if (chosen === null) some.textContent = kept === null ? "–" : "no draws"; else fill(some, chosen);
    return [all, some];
  }

  function drawTable(letter, found, kept) {
    const table = at(`table-${letter}`);
    table.hidden = found === null;
    if (found === null) return;
    const head = element("tr"), body = state.names.filter(name => has(found, name)).map(name => {
      const line = element("tr"), first = element("th", symbol(name));
      first.scope = "row";
      first.title = index.quantities[name]?.[1] ?? "";
      if (found.badges.some(([kind, what]) => kind === "dominated" && what === name)) first.append(" ", element("span", "prior", "badge dominated"));
      const share = having(found, name), present = count(Math.round(share * found.of));
      if (share < 1) first.append(element("div", `in ${present} of ${count(found.of)} draws: the posterior probability of this effect is ${probability(share)}`, "having"));
      if (name in found.truth) first.append(element("small", ` true ${written(found.truth[name])}`));
      line.append(first, ...cells(found, name, kept));
      return line;
    });
    head.append(...["quantity", "all draws: median [95 % interval]", "selected"].map(text => Object.assign(element("th", text), { scope: "col" })));
    const nothing = element("tr");
    nothing.append(Object.assign(element("td", "has none of the shown quantities"), { colSpan: 3 }));
    table.replaceChildren(element("caption", titled(letter, found)), head, ...(body.length > 0 ? body : [nothing]));
  }

  function drawBadges(letter, found) {
    const words = { unconverged: "not converged: ", misfit: "the model does not fit: ", untold: "", fine: "" };
    const told = found === null ? [] : found.badges.filter(([kind]) => kind !== "dominated").map(([kind, what]) => element("span", words[kind] + what, `badge ${kind}`));
    const ruled = found === null ? [] : found.badges.filter(([kind]) => kind === "dominated").map(([, name]) => symbol(name));
    if (ruled.length > 0) told.push(element("span", `determined by the prior: ${ruled.join(", ")}`, "badge dominated"));
    if (found?.synthetic) told.push(element("span", "synthetic data" + (Object.keys(found.truth).length > 0 ? ", truth marked" : ""), "badge"));
    at(`badges-${letter}`).replaceChildren(...told);
    const answers = found === null ? [] : found.words.map(([question, word]) => { const line = element("span", `${question} `); line.append(element("b", word)); return line; });
    at(`answer-${letter}`).replaceChildren(...answers);
  }

  function drawKey() {
    const lines = shown().map(letter => {
      const line = element("div"), sign = element("b", { a: "● ─ ", b: "▲ ┄ " }[letter], letter);
      sign.style.color = `var(--${letter})`;
      line.append(sign, titled(letter, entry(letter)));
      return line;
    });
    const average = shown().map(entry).some(found => found.of > Math.min(...found.with)) ? " that have both quantities" : "";
    lines.push(element("div", `contours: 50 and 95 % of all draws${average}`), element("div", "grey line on the diagonal: prior"));
    const rare = shown().flatMap(letter => state.names.filter(name => having(entry(letter), name) < 0.95)
      .map(name => `${letter.toUpperCase()} ${symbol(name).split(", ")[0]} ${probability(having(entry(letter), name))}`));
    if (rare.length > 0) lines.push(element("div", `An effect has as many draws as its posterior probability: ${rare.join(", ")}.`));
    const marks = { a: "×", b: "+" }, known = shown().filter(letter => Object.keys(entry(letter).truth).length > 0);
    if (known.length > 0) lines.push(element("div", `${known.map(letter => marks[letter]).join(" ")} and dash-dotted: truth`));
    at("key").replaceChildren(...lines);
  }

  function drawFooter() {
    const sources = [...new Set(shown().map(letter => entry(letter).about))].join(" ");
    at("footer").textContent = `${sources} ${index.footer} The page shows evenly spaced draws. Contours, medians and intervals for all draws use every draw.`;
  }

  // --- The whole page ------------------------------------------------------------------------------------------------------------------

  function follow() {  // what depends on the brush
    const kept = {}, told = [];
    for (const letter of LETTERS) {
      const found = entry(letter);
      kept[letter] = found === null ? null : rows(found);
      drawDraws("kept", letter, found, kept[letter]);
      drawCurves(letter, found, kept[letter]);
      drawAxis(letter, found, kept[letter]);
      drawTable(letter, found, kept[letter]);
      if (found !== null) told.push(sayShare(letter, found, kept[letter]));
    }
    drawFaint();
    drawDiagonals(kept);
    at("share").replaceChildren(...told);
    const ends = ([low, high]) => (low === -Infinity ? `up to ${written(high)}` : high === Infinity ? `from ${written(low)}` : `${written(low)} to ${written(high)}`);
    at("where").textContent = state.brush === null ? "nothing is selected; evenly spaced draws are shown, so that the page stays small"
      : "selected: " + Object.entries(state.brush.limits).map(([name, limits]) => `${symbol(name)} ${ends(limits)}`).join(", ");
    drawBoxes();
  }

  function drawBoxes() {
    for (const row of range(index.slots)) for (const column of range(row + 1)) {
      const box = model(`brush-panel-${row}-${column}`), limits = name => state.brush?.limits[name];
      const x = limits(state.names[column]), y = row === column ? null : limits(state.names[row]);
      const here = state.brush !== null && Boolean(x || y) && (Object.keys(state.brush.limits).length === 1 || Boolean(x && y));
      if (!here) { box.visible = false; continue; }
      const { x_range: across, y_range: up } = model(`panel-${row}-${column}`), within = (value, { start, end }) => Math.min(Math.max(value, start), end);
      const [left, right] = (x ?? [across.start, across.end]).map(value => within(value, across));
      const [bottom, top] = (y ?? [up.start, up.end]).map(value => within(value, up));
      box.setv({ visible: true, left, right, bottom, top });
    }
  }

  function redraw() {
    for (const letter of LETTERS) {
      const found = entry(letter), column = at(`column-${letter}`);
      column.hidden = found === null;
      document.querySelector(`fieldset.${letter} .posterior`).hidden = found === null || labels().length < 2;
      column.classList.toggle("alone", state.b === null);
      drawBadges(letter, found);
      fill(`truth-${letter}`, slots((name, slot) => ({ [slot]: found === null ? [] : [found.truth[name] ?? NaN] })));
      drawAnswers(letter, found);
      if (found === null) continue;
      at(`name-${letter}`).textContent = titled(letter, found);
      const words = [];
      if (found.undrawn > 0) words.push(`Curves: the ${found.slices.length} of ${found.slices.length + found.undrawn} ${index.fixed} stimuli with the most trials.`);
      at(`words-${letter}`).textContent = words.join(" ");
    }
    spans();
    layOut();  // before anything is filled: it paints at once, and new data are known to the figures a moment later only
    fainted = null;
    drawContours();
    drawBelieved();
    drawKey();
    drawFooter();
    follow();
  }

  function layOut() {
    const many = state.names.length, corner = at("corner"), narrow = corner.clientWidth < 420;
    const side = Math.floor(Math.min((corner.clientWidth - WORDS_LEFT) / many, 330));
    corner.style.gridTemplateColumns = `${side + WORDS_LEFT - AROUND}px repeat(${many - 1}, ${side}px)`;
    corner.style.gridTemplateRows = `repeat(${many - 1}, ${side}px) ${side + WORDS_BELOW - AROUND}px`;
    for (const row of range(index.slots)) for (const column of range(row + 1)) {
      const cell = at(`cell-${row}-${column}`), inside = row < many;
      cell.hidden = !inside;
      if (!inside) continue;
      cell.style.gridArea = `${row + 1} / ${column + 1}`;
      const panel = model(`panel-${row}-${column}`), left = column === 0, bottom = row === many - 1;
      panel.setv({ min_border_left: left ? WORDS_LEFT : AROUND, min_border_bottom: bottom ? WORDS_BELOW : AROUND });
      panel.below[0].setv({ visible: bottom, axis_label: symbol(state.names[column]) });
      panel.left[0].setv({ visible: left && row > 0, axis_label: symbol(state.names[row]) });
      for (const [axis, slot] of [[panel.below[0], column], [panel.left[0], row]]) axis.ticker.ticks = ticks(...limits(slot), side < 85 ? 2 : 3);
      if (row > column) {
        const value = (slot, axis) => [symbol(state.names[slot]), `@${axis}{0.000}`];
        const toward = (column + 0.5) * side + WORDS_LEFT < corner.clientWidth / 2 ? "right" : "left";  // so that the page does not grow
        model(`hover-panel-${row}-${column}`).setv({ attachment: toward, tooltips: [["", "$name"], value(column, "x"), value(row, "y")] });
      }
    }
    at("key").style.gridArea = many > 2 && !narrow ? `1 / 2 / 2 / ${many + 1}` : `${many + 1} / 1 / auto / ${many + 1}`;
  }

  // --- What people do ------------------------------------------------------------------------------------------------------------------

  function later() {  // once a frame, however often the mouse moves
    if (waiting) return;
    waiting = true;
    requestAnimationFrame(() => { waiting = false; follow(); });
  }

  function brushed(panel, geometry) {
    const [row, column] = panel.split("-").slice(1).map(Number), pair = (a, b) => [Math.min(a, b), Math.max(a, b)];
    const limits = { [state.names[column]]: pair(geometry.x0, geometry.x1) };
    if (row !== column) limits[state.names[row]] = pair(geometry.y0, geometry.y1);
    state.brush = { limits };
    later();
  }

  function reset() {
    state.brush = null;
    at("from").value = at("to").value = "";
    follow();
  }

  function typed(event) {
    event.preventDefault();
    const [from, to] = ["from", "to"].map(id => at(id).value);
    if (from === "" && to === "") return reset();
    const low = from === "" ? -Infinity : Number(from), high = to === "" ? Infinity : Number(to);
    state.brush = { limits: { [at("range-name").value]: [Math.min(low, high), Math.max(low, high)] } };
    follow();
  }

  const inert = text => /^'*[=+\-@\t\r]/.test(text) && isNaN(text) ? `'${text}` : text;  // no formula of a spreadsheet

  const quoted = text => /[",\n\r]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;

  const heading = name => [name, ...symbol(name).split(", ").slice(1).filter(unit => !unit.endsWith("ln"))].join("_").replace("%", "percent");

  function csv() {  // chain and draw count from 0, as in posterior.nc
    const names = [...new Set(shown().flatMap(letter => entry(letter).names))], lines = [["which", "subject", "posterior", "chain", "draw", ...names.map(heading)].join(",")];
    for (const letter of shown()) {
      const found = entry(letter);
      for (const row of rows(found) ?? range(found.rows)) {
        const place = Math.floor(row * found.of / found.rows);
        const number = value => value === undefined || isNaN(value) ? "" : String(Number(value.toPrecision(9)));
        const numbers = names.map(name => number(found.samples.get(name)?.[row]));
        lines.push([letter.toUpperCase(), quoted(inert(found.subject)), quoted(inert(found.label)), Math.floor(place / found.perChain), place % found.perChain, ...numbers].join(","));
      }
    }
    return lines.join("\n") + "\n";
  }

  function save() {
    const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(new Blob([csv()], { type: "text/csv" })), download: "selection.csv" });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  }

  // --- Choices -------------------------------------------------------------------------------------------------------------------------

  const options = (select, values, texts) => select.replaceChildren(...values.map((value, k) => new Option(texts[k], value)));

  const find = (subject, label) => {  // the entry of a subject in this tab, if possible with this label
    const own = places().filter(place => index.entries[place].subject === subject);
    return own.find(place => index.entries[place].label === label) ?? own[0] ?? null;
  };

  function choose(letter) {
    state[letter] = find(at(`subject-${letter}`).value, at(`label-${letter}`).value);
    refresh();
  }

  function refresh() {
    for (const letter of LETTERS) {
      const one = state[letter] === null ? { subject: "" } : index.entries[state[letter]];
      at(`subject-${letter}`).value = one.subject;
      at(`label-${letter}`).value = one.label;
    }
    const pairs = entry("a").slices.map(slice => slice.pairs.length), most = range(pairs.length).filter(k => pairs[k] === Math.max(...pairs));
    state.slice = most[Math.floor(most.length / 2)];  // the middle one of those with the most pairs
    offer();
    redraw();
  }

  function open(tab) {  // with the subjects that are shown, or else the first one and the next subject or posterior
    const [a, b] = LETTERS.map(letter => state[letter] === null ? "" : index.entries[state[letter]].subject), first = state.names.length === 0;
    state.tab = tab;
    state.brush = null;
    state.names = [];
    const own = places(), subjects = [...new Set(own.map(place => index.entries[place].subject))];
    options(at("subject-a"), subjects, subjects);
    options(at("subject-b"), ["", ...subjects], ["none", ...subjects]);
    for (const letter of LETTERS) options(at(`label-${letter}`), labels(), labels());
    state.a = find(a) ?? own[0];
    const subject = index.entries[state.a].subject, others = own.filter(place => place !== state.a);
    const next = others.find(place => index.entries[place].subject === subject) ?? others[0] ?? null;
    state.b = first || a === b ? next : find(b);
    document.body.dataset.tab = tab;
    for (const button of document.querySelectorAll("#tabs button")) button.setAttribute("aria-selected", button.textContent === tab);
    at("banner").hidden = tab === "effects";
    refresh();
  }

  function offer() {  // quantities, ranges and slices of what is chosen now
    const known = [...new Set(shown().flatMap(letter => entry(letter).names))];
    state.names = state.names.filter(name => known.includes(name));
    if (state.names.length === 0) state.names = opening();
    if (state.brush !== null && !Object.keys(state.brush.limits).every(name => known.includes(name))) state.brush = null;
    at("boxes").replaceChildren(...known.map(name => {
      const label = element("label"), box = Object.assign(element("input"), { type: "checkbox", value: name, checked: state.names.includes(name) });
      label.title = index.quantities[name]?.[1] ?? "";
      box.addEventListener("change", () => toggle(name, box));
      label.append(box, ` ${symbol(name)}`);
      return label;
    }));
    options(at("range-name"), known, known.map(name => symbol(name)));
    const titles = entry("a").slices.map(slice => slice.title);
    options(at("slice"), titles.map((_, k) => k), titles);
    at("slice").value = state.slice;
    at("slices").hidden = titles.length < 2;
  }

  function opening() {
    const most = at("corner").clientWidth < 420 ? 3 : index.slots;
    return [...new Set(shown().flatMap(letter => entry(letter).main))].slice(0, most);
  }

  function toggle(name, box) {
    const names = box.checked ? [...state.names, name] : state.names.filter(one => one !== name);
    if (names.length === 0 || names.length > index.slots) {
      box.checked = !box.checked;
      at("boxes").title = `between one and ${index.slots} at a time`;
      return;
    }
    const order = [...document.querySelectorAll("#boxes input")].map(one => one.value);
    state.names = order.filter(one => names.includes(one));
    redraw();
  }

  function paint() {  // figures in the colours of the page
    for (const model of doc.all_models) for (const [name, value] of Object.entries(model.attributes)) {
      if (!name.endsWith("_color")) continue;
      const colour = value?.value ?? value, key = `${model.id}.${name}`;
      if (!painted.has(key) && DARK[colour] !== undefined) painted.set(key, colour);
      if (!painted.has(key)) continue;
      const light = painted.get(key), now = dark.matches ? DARK[light] : light;
      model.setv({ [name]: value?.value === undefined ? now : { value: now } });
    }
  }

  function start(found) {
    doc = found;
    paint();
    document.body.dataset.painted = "yes";  // no figure is drawn in other colours before
    dark.addEventListener("change", paint);
    for (const letter of LETTERS) for (const one of ["subject", "label"]) at(`${one}-${letter}`).addEventListener("change", () => choose(letter));
    at("tabs").hidden = index.tabs.length < 2;
    at("tabs").replaceChildren(...index.tabs.map(tab => {
      const button = Object.assign(element("button", tab), { type: "button" });
      button.setAttribute("role", "tab");
      button.addEventListener("click", () => open(tab));
      return button;
    }));
    at("main").addEventListener("click", () => { state.names = opening(); offer(); redraw(); });
    at("slice").addEventListener("change", () => { state.slice = Number(at("slice").value); redraw(); });
    at("reset").addEventListener("click", reset);
    at("save").addEventListener("click", save);
    at("range").addEventListener("submit", typed);
    document.addEventListener("keydown", event => { if (event.key === "Escape") reset(); });
    let wide = 0;
    new ResizeObserver(() => { if (wide !== at("corner").clientWidth) { wide = at("corner").clientWidth; layOut(); } }).observe(at("corner"));
    open(index.tabs[0]);
    document.body.dataset.ready = "yes";
  }

  function begin() {  // once the figures are there
    if (window.Bokeh?.documents?.length) start(window.Bokeh.documents[0]);
    else setTimeout(begin, 20);
  }

  begin();
  return { brushed, csv, state };
})();
