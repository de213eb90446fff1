"use strict";
// Draws the figures of a page and asks for finer data when the view changes. Sets data-state of each figure:
// "drawn" with data-ms since the page was asked for, or "failed".

const WAIT_MS = 120;

function doubles(text) {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  return new Float64Array(bytes.buffer);
}

async function answer(address) {
  const response = await fetch(address);
  if (response.ok) return response.json();
  const said = response.headers.get("content-type").startsWith("text/plain");
  throw new Error(said ? await response.text() : response.statusText);
}

// Points with their GPS seconds, which a plot shows beside calendar time (s of x and t of y, both in ms past 1970).
function withSeconds(x, y) {
  const seconds = (one) => one / 1e3 - 946728000;
  return { x, y, s: Float64Array.from(x, seconds), t: Float64Array.from(y, seconds) };
}

// The view of a figure stands in the address: x of its first panel, which the others share, and y of each. Of the first
// figure these are from, to, low, high; a later figure adds its number, a later panel a point and its own. Finer data
// are asked for where the figure says from where.
function follow(place, panels) {
  const number = [...document.querySelectorAll("[data-figure]")].indexOf(place);
  const keep = (range, row, names, refresh) => {
    const own = names.map((name) => `${name}${number ? number + 1 : ""}${row ? `.${row + 1}` : ""}`);
    const asked = new URLSearchParams(location.search), [start, end] = own.map((name) => parseFloat(asked.get(name)));
    const whole = [range.start, range.end];
    let timer = null;
    range.change.connect(() => { clearTimeout(timer); timer = setTimeout(() => {
      const moved = range.type === "Range1d" ? range.start !== whole[0] || range.end !== whole[1] : range.have_updated_interactively;
      address({ [own[0]]: moved ? String(range.start) : "", [own[1]]: moved ? String(range.end) : "" });
      const link = document.getElementById("csv");
      if (link) link.search = location.search;
      if (refresh) refresh();
    }, WAIT_MS); });
    if (!(end > start)) return;
    range.have_updated_interactively = true;  // else Bokeh sets the range of a DataRange1d anew
    range.setv({ start, end });
  };
  keep(panels[0].x_range, 0, ["from", "to"], place.dataset.data && !place.dataset.fixed ? refine(place, panels[0]) : null);
  panels.forEach((panel, row) => keep(panel.y_range, row, ["low", "high"], null));
}

// Function that asks for the data of a figure between the ends of its view.
function refine(place, figure) {
  let latest = 0;
  const range = figure.x_range;
  return async () => {
    const own = ++latest;
    place.dataset.state = "refining";
    try {
      const sources = await answer(`${place.dataset.data}&from=${range.start}&to=${range.end}`);
      if (own !== latest) return;
      for (const [name, one] of Object.entries(sources)) {
        const source = figure.document.get_model_by_name(name);
        source.data = withSeconds(doubles(one.x), doubles(one.y));
      }
      place.dataset.state = "drawn";
      place.dataset.refined = String(Number(place.dataset.refined || 0) + 1);
    } catch (error) { place.dataset.state = "drawn"; console.error(error); }
  };
}

// What is chosen on a page stands in its address, so that it can be sent and kept.
function address(changes) {
  const asked = new URLSearchParams(location.search);
  for (const [name, value] of Object.entries(changes)) value ? asked.set(name, value) : asked.delete(name);
  const text = asked.toString();
  history.replaceState(null, "", text ? `?${text}` : location.pathname);
}

// Figures on dark paper where the page is dark, on white when it is printed.
function shade(views, panels) {
  const paint = { background_fill_color: "#16191d", border_fill_color: "#16191d", grid_line_color: "#333940",
    axis_label_text_color: "#e4e4e4", major_label_text_color: "#b5b5b5", axis_line_color: "#8a8a8a",
    major_tick_line_color: "#8a8a8a", label_text_color: "#e4e4e4" };
  const both = [];
  for (const model of views._all_models.values())
    for (const [name, colour] of Object.entries(paint))
      if (name in model.properties) both.push([model, name, model[name], colour]);
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const turn = (onPaper) => {
    for (const [model, name, day, night] of both) model[name] = dark.matches && !onPaper ? night : day;
    if (onPaper) for (const panel of panels) Bokeh.index.find_one(panel).paint();  // the printer does not wait
  };
  dark.addEventListener("change", () => turn(false));
  addEventListener("beforeprint", () => turn(true));
  addEventListener("afterprint", () => turn(false));
  turn(false);
}

async function draw(place) {
  try {
    const item = await answer(place.dataset.figure);
    const views = await Bokeh.embed.embed_item(item, place.id);
    const last = Bokeh.documents[Bokeh.documents.length - 1], panels = last.roots()[0].children || last.roots();
    shade(last, panels);
    for (let line = 0, source; (source = last.get_model_by_name(`line-${line}`)); line++)
      source.data = withSeconds(source.data.x, source.data.y);
    if (item.said) place.insertAdjacentHTML("afterend", "<p class='sub plotted'></p>");
    if (item.said) place.nextElementSibling.textContent = item.said;
    follow(place, panels);
    place.dataset.state = "drawn";
    place.dataset.ms = String(Math.round(performance.now()));
    return views;
  } catch (error) {
    place.classList.add("failed");
    place.textContent = `No plot: ${error.message}`;
    place.dataset.state = "failed";
    return null;
  }
}

async function drawAll() {
  for (const place of document.querySelectorAll("[data-figure]")) await draw(place);
}

// Words, all of which a row must have; "column:word" looks into one column.
function filterRows(field) {
  const table = field.closest("main").querySelectorAll(".scroll table.sortable");
  const own = [...table].find((one) => field.compareDocumentPosition(one) & Node.DOCUMENT_POSITION_FOLLOWING);
  const heads = [...own.tHead.rows[0].cells].map((cell) => cell.textContent.trim().toLowerCase());
  const show = () => {
    const words = field.value.toLowerCase().split(/\s+/).filter(Boolean);
    for (const row of own.tBodies[0].rows) {
      row.hidden = !words.every((word) => {
        const column = heads.indexOf(word.split(":")[0]);
        return (column >= 0 && word.includes(":"))
          ? row.cells[column].textContent.toLowerCase().includes(word.slice(word.indexOf(":") + 1))
          : row.textContent.toLowerCase().includes(word);
      });
    }
  };
  field.value = new URLSearchParams(location.search).get(field.name) || "";
  field.addEventListener("input", () => { show(); address({ [field.name]: field.value }); });
  show();
}

function sortBy(table, column, down) {
  const value = (row) => row.cells[column].dataset.sort || row.cells[column].textContent.trim();
  const number = (text) => parseFloat(text.replace("\u2212", "-"));
  const rows = [...table.tBodies[0].rows];
  const numbers = rows.every((row) => !value(row) || /^[-+\u2212]?[\d.]/.test(value(row)) && !/^\d{4}-\d\d/.test(value(row)));
  rows.sort((a, b) => numbers ? (number(value(a)) || 0) - (number(value(b)) || 0) : value(a).localeCompare(value(b)));
  table.tBodies[0].append(...(down ? rows.reverse() : rows));
  [...table.tHead.rows[0].cells].forEach((cell, at) => {
    if (at === column) cell.setAttribute("aria-sort", down ? "descending" : "ascending");
    else cell.removeAttribute("aria-sort");
  });
}

function sortable(table, number) {
  const name = number ? `sort${number + 1}` : "sort";
  [...table.tHead.rows[0].cells].forEach((cell, column) => {
    const button = document.createElement("button");
    button.textContent = cell.textContent;
    button.className = "sort";
    cell.replaceChildren(button);
    button.addEventListener("click", () => {
      const down = cell.getAttribute("aria-sort") === "ascending";
      sortBy(table, column, down);
      address({ [name]: `${down ? "-" : ""}${column}` });
    });
  });
  const asked = new URLSearchParams(location.search).get(name);
  const column = Math.abs(parseInt(asked, 10));
  if (asked && column < table.tHead.rows[0].cells.length) sortBy(table, column, asked.startsWith("-"));
}

// Cells say their column where rows are stacked on a narrow screen.
function stacked(table) {
  const heads = [...table.tHead.rows[0].cells].map((cell) => cell.textContent.trim());
  for (const row of table.tBodies[0].rows) [...row.cells].forEach((cell, at) => { cell.dataset.label = heads[at] || ""; });
}

function zoom(button) {
  const chain = document.querySelector("svg.chain"), width = chain.viewBox.baseVal.width;
  const now = chain.getBoundingClientRect().width, factor = Number(button.dataset.zoom);
  const wide = factor ? Math.min(Math.max(now * factor, width / 4), 4 * width) : chain.parentElement.clientWidth;
  chain.style.width = `${wide}px`;
  chain.style.minWidth = "0";
  chain.style.maxWidth = "none";
  address({ zoom: factor ? (wide / width).toFixed(3) : "" });
}

function zoomAsked() {
  const chain = document.querySelector("svg.chain"), asked = Number(new URLSearchParams(location.search).get("zoom"));
  if (!chain || !(asked >= 0.25 && asked <= 4)) return;
  Object.assign(chain.style, { width: `${asked * chain.viewBox.baseVal.width}px`, minWidth: "0", maxWidth: "none" });
}

function submitOnChange(form) {
  form.addEventListener("change", (event) => {
    const other = event.target.dataset.reset && form.elements[event.target.dataset.reset];
    if (other) other.disabled = true;
    form.submit();
  });
}

document.querySelectorAll("table.stacked").forEach(stacked);
document.querySelectorAll("table.sortable").forEach(sortable);
document.querySelectorAll(".filter").forEach(filterRows);
document.querySelectorAll("[data-zoom]").forEach((one) => one.addEventListener("click", () => zoom(one)));
zoomAsked();
document.querySelectorAll("form.controls").forEach(submitOnChange);
drawAll();
