"use strict";

const STATUSES = ["nothing", "certain", "ambiguous", "failed"];
// red, green and blue of pixels that are not certain, by status, as in the viewer
const PROOF_COLORS = { 2: [255, 0, 200], 3: [255, 60, 0] };
const TYPES = { uint8: Uint8Array, int32: Int32Array, float32: Float32Array, float64: Float64Array };
const STEPS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

const find = (id) => document.getElementById(id);
const { quantity, directions, times, views } = JSON.parse(find("record").textContent);
const figure = find("picture");
const told = find("told");
const images = [...figure.querySelectorAll("img")];
const unpacked = [];
// views stand by times, then by directions
const perTime = Math.max(1, directions.length);
let current = 0;
let pinned = null; // column and row of the pixel that was clicked
let hovered = null;

// an array of a record: bytes are deflated, all first bytes of the numbers before all second ones
async function unpack({ type, data }) {
  const packed = Uint8Array.from(atob(data), (character) => character.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  const planes = new Uint8Array(await new Response(stream).arrayBuffer());
  const width = TYPES[type].BYTES_PER_ELEMENT;
  const count = planes.length / width;
  const bytes = new Uint8Array(planes.length);
  for (let plane = 0; plane < width; plane++) {
    for (let number = 0; number < count; number++) bytes[number * width + plane] = planes[plane * count + number];
  }
  return new TYPES[type](bytes.buffer);
}

async function unpackView(number) {
  const names = ["value", "depth", "element", "status", "proof"];
  const arrays = await Promise.all(names.map((name) => unpack(views[number][name])));
  return Object.fromEntries(names.map((name, k) => [name, arrays[k]]));
}

// the point of a pixel's ray at a depth, rounded to the digits of the depth
function pointAt({ is_perspective, eye, forward, corner, column, row }, [x, y], depth) {
  const step = 10 ** Math.floor(Math.log10(Math.abs(depth) * 1e-6 || 1e-6));
  return eye.map((start, axis) => {
    const aside = corner[axis] + x * column[axis] + y * row[axis];
    const point = start + depth * forward[axis] + (is_perspective ? depth * aside : aside);
    return Number((Math.round(point / step) * step).toPrecision(7));
  });
}

function describe([x, y]) {
  const view = views[current];
  const record = unpacked[current];
  const pixel = y * view.size[0] + x;
  const parts = [];
  if (record.element[pixel] >= 0) {
    const value = record.value[pixel];
    parts.push(`${quantity} = ${Number.isNaN(value) ? "not a number" : value.toPrecision(6)}`);
    if (Number.isFinite(record.depth[pixel])) parts.push(`at (${pointAt(view.rays, [x, y], record.depth[pixel]).join(", ")})`);
    parts.push(`element ${record.element[pixel]}`);
  }
  const status = STATUSES[record.status[pixel]];
  const ofLines = STATUSES[record.proof[pixel]];
  parts.push(ofLines === status ? status : `${status}, contours ${ofLines}`);
  return [...parts, `pixel ${x}, ${y}`].join("  ");
}

function show() {
  const place = hovered ?? pinned;
  if (place && unpacked[current]) told.textContent = describe(place);
  const view = views[current];
  find("cross").hidden = !pinned;
  if (pinned) {
    find("cross").style.left = `${100 * (view.corner[0] + pinned[0] + 0.5) / view.page[0]}%`;
    find("cross").style.top = `${100 * (view.corner[1] + pinned[1] + 0.5) / view.page[1]}%`;
  }
}

// column and row of the record under the pointer; null beside it
function pixelUnder(event) {
  const { size, page, corner } = views[current];
  const box = images[current].getBoundingClientRect();
  const place = [event.clientX - box.left, event.clientY - box.top].map((offset, k) => Math.floor(offset * page[k] / [box.width, box.height][k]) - corner[k]);
  return place.every((own, k) => own >= 0 && own < size[k]) ? place : null;
}

// marks over the picture for the pixels that are not certain, and their numbers
function prove() {
  const { size, page, corner } = views[current];
  const statuses = unpacked[current].proof;
  const counts = [0, 0, 0, 0];
  for (const status of statuses) counts[status] += 1;
  const legend = [2, 3].flatMap((status) => {
    const swatch = document.createElement("i");
    swatch.className = "swatch";
    swatch.style.background = `rgb(${PROOF_COLORS[status]})`;
    return [swatch, `${counts[status]} ${STATUSES[status]}`];
  });
  find("counts").replaceChildren(`${counts[1]} pixels certain`, ...legend);

  const isOn = find("proof").checked;
  const canvas = find("marks");
  figure.classList.toggle("proof", isOn);
  canvas.hidden = !isOn;
  if (!isOn) return;
  [canvas.width, canvas.height] = size;
  const marks = new ImageData(...size);
  statuses.forEach((status, pixel) => {
    if (PROOF_COLORS[status]) marks.data.set([...PROOF_COLORS[status], 255], 4 * pixel);
  });
  canvas.getContext("2d").putImageData(marks, 0, 0);
  const percent = [corner[0] / page[0], corner[1] / page[1], size[0] / page[0], size[1] / page[1]].map((part) => `${100 * part}%`);
  [canvas.style.left, canvas.style.top, canvas.style.width, canvas.style.height] = percent;
}

async function turnTo(number) {
  current = number;
  images.forEach((image, k) => { image.hidden = k !== number; });
  find("angle").textContent = directions[number % perTime] ?? "";
  find("time").textContent = times[Math.floor(number / perTime)] ?? "";
  unpacked[number] ??= await unpackView(number);
  if (current !== number) return;
  prove();
  show();
  figure.dataset.shown = number;
}

for (const kind of ["pointerdown", "pointermove"]) {
  figure.addEventListener(kind, (event) => {
    hovered = pixelUnder(event);
    show();
  });
}
figure.addEventListener("pointerleave", () => {
  hovered = null;
  show();
});
// a click itself has whole coordinates only
figure.addEventListener("click", () => {
  pinned = hovered;
  show();
});
figure.addEventListener("keydown", (event) => {
  const step = STEPS[event.key];
  if (!step) return;
  event.preventDefault();
  const { size } = views[current];
  const start = pinned ?? size.map((own) => Math.floor(own / 2));
  const far = event.shiftKey ? 10 : 1;
  pinned = start.map((own, k) => Math.min(size[k] - 1, Math.max(0, own + far * step[k])));
  hovered = null;
  show();
});
find("proof").addEventListener("change", prove);
const chosen = () => turnTo(Number(find("step").value) * perTime + Number(find("direction").value));
for (const [name, label, count] of [["direction", "turning", perTime], ["step", "passing", views.length / perTime]]) {
  find(name).addEventListener("input", chosen);
  find(name).max = count - 1;
  find(label).hidden = count < 2;
}
turnTo(0).catch((error) => { told.textContent = `This browser cannot unpack the values: ${error.message}`; });
