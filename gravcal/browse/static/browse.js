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
  const content = await response.json();
  if (!response.ok) throw new Error(content.error || response.statusText);
  return content;
}

function follow(place, figure) {
  let timer = null, latest = 0;
  const range = figure.x_range;
  const refresh = async () => {
    const own = ++latest;
    place.dataset.state = "refining";
    try {
      const sources = await answer(`${place.dataset.data}&from=${range.start}&to=${range.end}`);
      if (own !== latest) return;
      for (const [name, one] of Object.entries(sources)) {
        const source = figure.document.get_model_by_name(name);
        source.data = { x: doubles(one.x), y: doubles(one.y) };
      }
      place.dataset.state = "drawn";
      place.dataset.refined = String(Number(place.dataset.refined || 0) + 1);
    } catch (error) { place.dataset.state = "drawn"; console.error(error); }
  };
  const later = () => { clearTimeout(timer); timer = setTimeout(refresh, WAIT_MS); };
  range.properties.start.change.connect(later);
  range.properties.end.change.connect(later);
}

async function draw(place) {
  try {
    const item = await answer(place.dataset.figure);
    const views = await Bokeh.embed.embed_item(item, place.id);
    const last = Bokeh.documents[Bokeh.documents.length - 1];
    const figure = place.dataset.data ? last.get_model_by_name("figure") : null;
    if (item.said) place.insertAdjacentHTML("afterend", "<p class='sub plotted'></p>");
    if (item.said) place.nextElementSibling.textContent = item.said;
    if (figure && !place.dataset.fixed) follow(place, figure);
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

function filterRows(field) {
  const table = field.nextElementSibling.querySelector("tbody");
  field.addEventListener("input", () => {
    const words = field.value.toLowerCase().split(/\s+/);
    for (const row of table.rows) {
      const text = row.textContent.toLowerCase();
      row.hidden = !words.every((word) => text.includes(word));
    }
  });
}

function submitOnChange(form) {
  form.addEventListener("change", (event) => {
    const other = event.target.dataset.reset && form.elements[event.target.dataset.reset];
    if (other) other.disabled = true;
    form.submit();
  });
}

document.querySelectorAll(".filter").forEach(filterRows);
document.querySelectorAll("form.controls").forEach(submitOnChange);
drawAll();
