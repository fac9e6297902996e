// The viewer: one module for the page that `elvis view` serves and for notebooks (the form of anywidget).
// A model sends JSON and hands on what comes: {type: "schema" | "state" | "frame" | "answer" | "error", …}, pictures as buffers.

// ---------------------------------------------------------------- vectors

const plus = (a, b) => a.map((x, i) => x + b[i]);
const minus = (a, b) => a.map((x, i) => x - b[i]);
const times = (s, a) => a.map((x) => s * x);
const dot = (a, b) => a.reduce((sum, x, i) => sum + x * b[i], 0);
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const length = (a) => Math.hypot(...a);
const unit = (a) => times(1 / (length(a) || 1), a);

// Rodrigues' formula: v turned about a unit axis
function turned(v, axis, angle) {
  const c = Math.cos(angle), s = Math.sin(angle);
  return plus(plus(times(c, v), times(s, cross(axis, v))), times((1 - c) * dot(axis, v), axis));
}

// ---------------------------------------------------------------- cameras

// right, up and forward of a camera, and world units of a pixel in the plane through its target
function frameOf(camera, pixels) {
  const forward = unit(minus(camera.at, camera.eye));
  const right = unit(cross(forward, camera.up));
  const up = cross(right, forward);
  const distance = length(minus(camera.at, camera.eye));
  const height = camera.fov ? 2 * distance * Math.tan((camera.fov * Math.PI) / 360) : camera.height;
  return { right, up, forward, distance, height, pixel: height / pixels };
}

function orbit(camera, centre, across, down, isFree) {
  const { right, up } = frameOf(camera, 1);
  const axis = isFree ? up : unit(camera.pole);
  const round = (v) => turned(turned(v, right, -down), axis, -across);
  let result = {
    ...camera,
    eye: plus(centre, round(minus(camera.eye, centre))),
    at: plus(centre, round(minus(camera.at, centre))),
    up: round(up),
  };
  return result;
}

function pan(camera, dx, dy, pixels) {
  const { right, up, pixel } = frameOf(camera, pixels);
  const step = plus(times(-dx * pixel, right), times(dy * pixel, up));
  return { ...camera, eye: plus(camera.eye, step), at: plus(camera.at, step) };
}

// what lies under the pointer, x and y pixels from the middle, stays there
function zoom(camera, factor, x, y, pixels) {
  const { right, up, pixel, forward, distance } = frameOf(camera, pixels);
  const aside = plus(times(x * pixel, right), times(-y * pixel, up));
  const step = times(1 - factor, aside);
  if (!camera.fov) return { ...camera, height: camera.height * factor, eye: plus(camera.eye, step), at: plus(camera.at, step) };
  const at = plus(camera.at, step);
  return { ...camera, at, eye: minus(at, times(distance * factor, forward)) };
}

function projected(camera, isPerspective) {
  const { forward, distance, height } = frameOf(camera, 1);
  const { fov, height: _, ...rest } = camera;
  if (!isPerspective) return { ...rest, height };
  const angle = 30;
  const away = height / (2 * Math.tan((angle * Math.PI) / 360));
  return { ...rest, fov: angle, eye: minus(camera.at, times(away, forward)) };
}

const plain = ({ eye, at, up, fov, height }) => (fov ? { eye, at, up, fov } : { eye, at, up, height });

// ---------------------------------------------------------------- small helpers of the page

function make(tag, properties = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (name in element && name !== "list") element[name] = value;
    else element.setAttribute(name, value);
  }
  element.append(...children);
  return element;
}

const short = (value) => (typeof value === "number" ? String(Number(value.toPrecision(6))) : String(value));
const words = (name) => name.replaceAll("_", " ");
let counter = 0;

// ---------------------------------------------------------------- controls, made from the schema of scenes

const QUANTITIES = new Set(["field", "quantity", "expression"]);
const OPTIONAL = (schema) => schema.anyOf?.some((one) => one.type === "null");

class Controls {
  constructor(schema, facts, palettes, check) {
    Object.assign(this, { schema, facts, palettes, check });
  }

  resolve(schema) {
    return schema.$ref ? { ...this.schema.$defs[schema.$ref.split("/").pop()], description: schema.description } : schema;
  }

  // a value that is valid where nothing is known
  start(schema, key) {
    const own = this.resolve(schema);
    const usual = {
      point: this.middle(), center: this.middle(), apex: this.middle(), normal: [0, 0, 1], axis: [0, 0, 1],
      radius: this.extent() / 4, angle: 30, expression: this.facts?.quantities?.[0] ?? "x", values: [0], count: 10,
      densities: [0, 1], file: "surface.stl", direction: [1, 1, 1], linear: 1e-3,
    };
    if (key in usual) return usual[key];
    if (own.default !== undefined && own.default !== null) return own.default;
    if (own.anyOf) return this.start(own.anyOf.find((one) => one.type !== "null"), key);
    if (own.oneOf) return this.start(own.oneOf[0], key);
    if (own.enum) return own.enum[0];
    if (own.prefixItems) return own.prefixItems.map((item) => item.minimum ?? 0);
    if (own.type === "object") {
      const needed = own.required ?? [];
      const kind = own.properties.kind ? { kind: own.properties.kind.const } : {};
      if (own.description?.startsWith("Lines of equal value")) return { count: 10 };
      return Object.assign(kind, Object.fromEntries(needed.map((name) => [name, this.start(own.properties[name], name)])));
    }
    return { number: own.minimum ?? own.exclusiveMinimum ?? 1, integer: own.minimum ?? 1, boolean: false, string: "", array: [] }[own.type];
  }

  middle() {
    const box = this.facts?.box;
    return box ? times(0.5, plus(box[0], box[1])) : [0, 0, 0];
  }

  extent() {
    const box = this.facts?.box;
    return box ? length(minus(box[1], box[0])) : 1;
  }

  // a labelled control of a setting; set(value, isMoving), undefined where it is to have its default
  row(key, schema, value, set) {
    const own = this.resolve(schema);
    const id = `elvis-${++counter}`;
    const control = this.control(key, own, value, set, id);
    if (control.tagName === "DETAILS") return control;
    const label = make("label", { htmlFor: id, title: own.description ?? "" }, words(key));
    return make("div", { className: "elvis-row" }, label, control);
  }

  control(key, own, value, set, id) {
    if (OPTIONAL(own)) return this.optional(key, own, value, set, id);
    if (own.oneOf && own.discriminator) return this.variants(key, own, value, set);
    if (own.oneOf) return this.alternatives(key, own, value, set, id);
    if (own.type === "object") return this.group(key, own, value ?? {}, set);
    if (own.type === "boolean") {
      return make("input", { id, type: "checkbox", checked: value ?? own.default ?? false, onchange: (e) => set(e.target.checked) });
    }
    if (own.enum) return this.choice(own.enum, value ?? own.default, set, id);
    if (own.prefixItems) return this.numbers(key, own, value ?? own.default, set, id);
    if (key === "background") return this.color(value ?? own.default, set, id);
    if (own.type === "array") return this.list(key, own, value ?? own.default ?? [], set, id);
    if (own.type === "number" || own.type === "integer") return this.number(own, value ?? own.default, set, id);
    return this.text(key, value ?? own.default ?? "", set, id);
  }

  number(own, value, set, id) {
    const [low, high] = [own.minimum ?? own.exclusiveMinimum, own.maximum];
    const field = make("input", { id, type: "number", step: own.type === "integer" ? 1 : "any", value: value ?? "",
      onchange: (e) => e.target.value !== "" && set(Number(e.target.value)) });
    if (low === undefined || high === undefined || own.type === "integer") return field;
    const slider = make("input", { type: "range", min: low, max: high, step: (high - low) / 200, value: value ?? low,
      "aria-label": "slider", oninput: (e) => { field.value = e.target.value; set(Math.max(Number(e.target.value), low + (own.exclusiveMinimum === low ? 0.005 : 0)), true); },
      onchange: (e) => set(Math.max(Number(e.target.value), low + (own.exclusiveMinimum === low ? 0.005 : 0))) });
    return make("div", { className: "elvis-several" }, slider, field);
  }

  numbers(key, own, value, set, id) {
    if (key === "color") return this.color(value, set, id);
    const current = [...(value ?? own.prefixItems.map(() => 0))];
    const fields = current.map((one, i) => make("input", { id: i ? "" : id, type: "number", step: "any", value: Number(one.toPrecision(9)),
      "aria-label": `${key} ${i + 1}`, onchange: (e) => { current[i] = Number(e.target.value); set([...current]); } }));
    return make("div", { className: "elvis-several" }, ...fields);
  }

  color(value, set, id) {
    const hex = (value ?? [1, 1, 1]).slice(0, 3).map((x) => Math.round(255 * x).toString(16).padStart(2, "0")).join("");
    const read = (e) => [1, 3, 5].map((i) => parseInt(e.target.value.slice(i, i + 2), 16) / 255);
    return make("input", { id, type: "color", value: `#${hex}`, onchange: (e) => set(read(e)) });
  }

  choice(options, value, set, id) {
    const known = options.includes(value) || value === undefined ? options : [value, ...options];
    const select = make("select", { id, onchange: (e) => set(known[e.target.selectedIndex]) },
      ...known.map((one) => make("option", {}, String(one))));
    select.selectedIndex = Math.max(0, known.indexOf(value));
    return select;
  }

  text(key, value, set, id) {
    const names = key === "palette" ? this.palettes : QUANTITIES.has(key) ? this.facts?.quantities ?? [] : null;
    const usual = QUANTITIES.has(key) ? this.facts?.shown ?? "" : "";
    const field = make("input", { id, type: "text", value, spellcheck: false, placeholder: usual,
      onchange: (e) => set(e.target.value === "" ? undefined : e.target.value) });
    if (!names) return field;
    const listed = make("datalist", { id: `${id}-names` }, ...names.map((name) => make("option", { value: name })));
    field.setAttribute("list", listed.id);
    const note = make("div", { className: "elvis-note" });
    if (QUANTITIES.has(key)) {
      field.addEventListener("input", async () => {
        const answer = field.value ? await this.check(field.value) : null;
        field.classList.toggle("elvis-invalid", Boolean(answer));
        note.textContent = answer ?? "";
      });
    }
    return make("div", {}, field, listed, note);
  }

  list(key, own, value, set, id) {
    const isText = own.items?.type === "string";
    if (own.items && !["number", "string", "integer"].includes(own.items.type)) return this.items(key, own, value, set);
    const read = (text) => text.split(/[\s,;]+/).filter(Boolean).map((one) => (isText ? one : Number(one)));
    const field = make("input", { id, type: "text", value: value.map(short).join(", "), spellcheck: false,
      onchange: (e) => set(read(e.target.value)) });
    if (!isText || !this.facts?.boundaries?.length) return field;
    const boxes = ["all", ...this.facts.boundaries].map((name) => make("label", {}, make("input", { type: "checkbox", checked: value.includes(name),
      onchange: (e) => set(e.target.checked ? [...value, name] : value.filter((one) => one !== name)) }), ` ${name} `));
    return make("div", {}, field, ...boxes);
  }

  items(key, own, value, set) {
    const rows = value.map((one, i) => {
      const take = (next, moving) => set(value.map((old, k) => (k === i ? next : old)), moving);
      const remove = make("button", { type: "button", title: `Remove`, onclick: () => set(value.filter((_, k) => k !== i)) }, "×");
      return make("div", { className: "elvis-item" }, this.control(`${key} ${i + 1}`, this.resolve(own.items), one, take, `elvis-${++counter}`), remove);
    });
    const add = make("button", { type: "button", onclick: () => set([...value, this.start(own.items, key)]) }, `add`);
    return this.fold(key, "", [...rows, add], value.length > 0);
  }

  optional(key, own, value, set, id) {
    const inner = this.resolve(own.anyOf.find((one) => one.type !== "null"));
    const isSet = value !== undefined && value !== null;
    if (inner.type === "string" && !inner.enum) return this.text(key, value ?? "", set, id);
    const box = make("input", { id, type: "checkbox", checked: isSet, "aria-label": words(key),
      onchange: (e) => set(e.target.checked ? this.start(own, key) : undefined) });
    if (!isSet) return box;
    const control = this.control(key, inner, value, set, `${id}-own`);
    return control.tagName === "DETAILS" ? this.fold(key, "", [make("label", {}, box, ` ${words(key)}`), ...control.lastChild.childNodes], true)
      : make("div", { className: "elvis-several" }, box, control);
  }

  alternatives(key, own, value, set, id) {
    const named = own.oneOf.find((one) => one.enum);
    const other = own.oneOf.find((one) => !one.enum);
    if (typeof value === "string" || value === undefined) {
      const options = [...(named?.enum ?? []), "own values"];
      return this.choice(options, value ?? own.default, (one) => set(one === "own values" ? this.start(other, key) : one), id);
    }
    const back = make("button", { type: "button", title: `Back to ${named?.enum?.[0] ?? "the default"}`, onclick: () => set(named?.enum?.[0]) }, "×");
    return make("div", { className: "elvis-several" }, this.control(key, this.resolve(other), value, set, id), back);
  }

  variants(key, own, value, set) {
    const kinds = Object.keys(own.discriminator.mapping);
    const schemaOf = (kind) => this.resolve({ $ref: own.discriminator.mapping[kind] });
    const select = this.choice(kinds, value.kind, (kind) => set(this.start(schemaOf(kind), key)), `elvis-${++counter}`);
    return this.fold(key, value.kind, [select, ...this.rows(schemaOf(value.kind), value, set)], true);
  }

  group(key, own, value, set) {
    return this.fold(key, "", this.rows(own, value, set), false);
  }

  rows(own, value, set) {
    return Object.entries(own.properties).filter(([name]) => name !== "kind").map(([name, one]) =>
      this.row(name, one, value[name], (next, moving) => {
        const { [name]: _, ...rest } = value;
        set(next === undefined ? rest : { ...rest, [name]: next }, moving);
      }));
  }

  fold(key, summary, children, open) {
    const details = make("details", { open: Controls.open.get(key) ?? open },
      make("summary", {}, `${words(key)}${summary ? `: ${summary}` : ""}`), make("div", {}, ...children));
    details.addEventListener("toggle", () => Controls.open.set(key, details.open));
    return details;
  }
}
Controls.open = new Map();

// ---------------------------------------------------------------- the viewer

const VIEWS = { "+x": "+x", "−x": "-x", "+y": "+y", "−y": "-y", "+z": "+z", "−z": "-z", iso: "iso" };
const COLOUR = ["field", "palette", "range", "bar"];
const LIGHT = ["lights", "ambient", "background", "samples"];
const FIGURE = ["title", "axes", "scale_bar", "box", "outline", "font_size"];
const STEP = Math.PI / 24;

class Viewer {
  constructor(model, el) {
    Object.assign(this, { model, table: {}, facts: null, picture: null, hidden: [], waiting: new Map(), mode: "turn", line: [] });
    this.build(el);
    model.on((message, buffer) => this.receive(message, buffer));
    model.open();
  }

  build(el) {
    this.canvas = make("canvas", { width: 16, height: 16, "aria-label": "the picture" });
    this.error = make("div", { className: "elvis-error", hidden: true, role: "alert" });
    this.stage = make("div", { className: "elvis-stage", tabIndex: 0, "aria-label": "picture: arrow keys turn, + and - zoom, shift and arrows pan, f fits" },
      this.canvas, this.error);
    this.panel = make("div", { className: "elvis-panel" });
    this.values = make("output", { "aria-label": "values under the pointer" });
    this.counts = make("span", {});
    this.root = make("div", { className: "elvis" }, this.tools(), this.stage, this.panel, make("div", { className: "elvis-status" }, this.counts, this.values));
    this.dialog = make("dialog", {});
    this.root.append(this.dialog);
    el.append(this.root);
    this.listen();
    new ResizeObserver(() => this.sized()).observe(this.stage);
  }

  tools() {
    const button = (text, title, act) => make("button", { type: "button", title, onclick: act }, text);
    this.undoButton = button("↶", "Undo (ctrl z)", () => this.model.send({ type: "undo" }));
    this.redoButton = button("↷", "Redo (ctrl y)", () => this.model.send({ type: "redo" }));
    this.proofButton = button("proof", "Show which pixels are not certain", () => this.model.send({ type: "proof", on: this.proofButton.ariaPressed !== "true" }));
    this.lineButton = button("line", "Two clicks: exact values along a line", () => this.setMode(this.mode === "line" ? "turn" : "line"));
    this.freeButton = button("free", "Turn freely, not about the axis that stands upright", () => { this.freeButton.ariaPressed = String(this.freeButton.ariaPressed !== "true"); });
    this.perspectiveButton = button("perspective", "Perspective or parallel view", () => this.look((camera) => projected(camera, !camera.fov)));
    for (const one of [this.proofButton, this.lineButton, this.freeButton, this.perspectiveButton]) one.ariaPressed = "false";
    const saving = make("select", { "aria-label": "save", onchange: (e) => this.save(e.target) },
      ...["save…", "picture .png", "figure .svg", "figure .pdf", "record .npz", "record .exr", "scene .toml", "scene .yaml", "copy command", "copy Python"].map((text) => make("option", {}, text)));
    const views = Object.entries(VIEWS).map(([text, view]) => button(text, `View ${view}`, () => this.change({ camera: view })));
    const menu = button("≡", "Objects and colours", () => this.root.classList.toggle("elvis-open"));
    menu.className = "elvis-menu";
    return make("div", { className: "elvis-tools" }, menu, button("fit", "Show all (f)", () => this.fit()), ...views,
      this.perspectiveButton, this.freeButton, this.lineButton, this.proofButton, this.undoButton, this.redoButton, saving);
  }

  // ---- messages

  receive(message, buffer) {
    const act = { schema: () => this.learn(message), state: () => this.update(message), frame: () => this.show(message, buffer),
      answer: () => this.settle(message.id, buffer ?? message.content), error: () => this.fail(message), closed: () => this.fail(message) }[message.type];
    act?.();
  }

  learn({ schema, palettes }) {
    Object.assign(this, { schema, palettes });
    this.sized();
  }

  update({ table, facts, undo, redo, proof }) {
    Object.assign(this, { table, facts: facts ? { ...facts, shown: this.facts?.shown } : this.facts });
    this.undoButton.disabled = !undo;
    this.redoButton.disabled = !redo;
    this.proofButton.ariaPressed = String(proof);
    if (!this.dragged) this.camera = null;
    this.controls();
  }

  ask(type, content, more = {}) {
    const id = ++counter;
    this.model.send({ type, id, content, ...more });
    return new Promise((resolve, reject) => this.waiting.set(id, { resolve, reject }));
  }

  settle(id, content) {
    this.waiting.get(id)?.resolve(content);
    this.waiting.delete(id);
  }

  fail({ id, text }) {
    if (this.waiting.has(id)) {
      this.waiting.get(id).reject(new Error(text));
      this.waiting.delete(id);
      return;
    }
    this.error.textContent = text;
    this.error.hidden = false;
  }

  change(changes, moving = false) {
    this.model.send({ type: "change", changes, moving });
  }

  // ---- pictures

  async show(facts, buffer) {
    const picture = await createImageBitmap(new Blob([buffer]));
    this.model.send({ type: "shown" });
    this.error.hidden = true;
    const context = this.canvas.getContext("2d");
    if (facts.final) {
      this.canvas.width = facts.size[0];
      this.canvas.height = facts.size[1];
      const ratio = window.devicePixelRatio || 1;
      this.canvas.style.width = `${facts.size[0] / ratio}px`;
      this.canvas.style.height = `${facts.size[1] / ratio}px`;
      context.drawImage(picture, 0, 0);
      const margins = [facts.size[0] - facts.image[2], facts.size[1] - facts.image[3]];
      // what stands around the image grows with it: a few steps fit the whole page into the window
      const differ = !this.margins || margins.some((one, i) => Math.abs(one - this.margins[i]) > 2);
      this.fitting = differ ? (this.fitting ?? 0) + 1 : 0;
      this.margins = margins;
      this.picture = facts;
      this.told(facts);
      if (differ && this.fitting < 4) this.sized();
    } else if (this.picture) {
      context.imageSmoothingEnabled = true;
      context.drawImage(picture, ...this.picture.image);
    } else {
      this.canvas.width = facts.size[0];
      this.canvas.height = facts.size[1];
      context.drawImage(picture, 0, 0);
      this.picture = facts;
    }
    this.frames = (this.frames ?? 0) + 1;
    if (!this.dragged) this.camera = null;
    if (this.facts && this.facts.shown !== facts.field) {
      this.facts.shown = facts.field;
      this.controls();
    }
    this.picture.camera = facts.camera;
    this.picture.ranges = facts.ranges;
    this.root.dataset.final = facts.final ? facts.revision : "";
    picture.close();
  }

  told({ counts, remarks }) {
    const shown = ["certain", "ambiguous", "failed"].filter((name) => counts[name] || name === "certain");
    this.counts.textContent = shown.map((name) => `${counts[name]} ${name}`).join(", ");
    this.counts.title = remarks.join("\n");
  }

  sized() {
    const ratio = window.devicePixelRatio || 1;
    const room = [this.stage.clientWidth * ratio, this.stage.clientHeight * ratio];
    // what stands around an image is proportional to its smaller side
    const own = this.margins ? Math.min(...this.picture.image.slice(2)) : 600;
    const part = Math.min(...room) / (own + Math.max(...(this.margins ?? [120, 70])));
    const size = (this.margins ?? [120, 70]).map((margin, i) => Math.max(64, Math.floor(room[i] - margin * part)));
    clearTimeout(this.sizing);
    this.sizing = setTimeout(() => this.schema && this.model.send({ type: "size", size }), 120);
  }

  // ---- the camera

  current() {
    const camera = this.camera ?? this.picture?.camera;
    if (!camera) return null;
    const up = camera.up ?? [0, 0, 1];
    const axis = up.map(Math.abs).indexOf(Math.max(...up.map(Math.abs)));
    const pole = camera.pole ?? [0, 1, 2].map((i) => (i === axis ? Math.sign(up[axis]) : 0));
    return { ...camera, up, pole };
  }

  look(change, moving = false) {
    const camera = this.current();
    if (!camera) return;
    this.camera = change(camera);
    this.perspectiveButton.ariaPressed = String(Boolean(this.camera.fov));
    if (!moving) {
      this.change({ camera: plain(this.camera) });
      return;
    }
    if (this.pending) return;
    this.pending = requestAnimationFrame(() => {
      this.pending = 0;
      if (this.camera) this.change({ camera: plain(this.camera) }, true);
    });
  }

  fit() {
    this.centre = null;
    this.change({ camera: "fit" });
  }

  pixels() {
    return this.picture?.image[3] ?? 1;
  }

  // column and row of the picture's image under the pointer
  place(event) {
    const box = this.canvas.getBoundingClientRect();
    const scale = this.canvas.width / box.width;
    const [x, y] = this.picture?.image ?? [0, 0];
    return [(event.clientX - box.left) * scale - x, (event.clientY - box.top) * scale - y];
  }

  listen() {
    const stage = this.canvas;
    stage.addEventListener("pointerdown", (e) => this.press(e));
    stage.addEventListener("pointermove", (e) => (this.dragged ? this.drag(e) : this.hover(e)));
    stage.addEventListener("pointerup", (e) => this.release(e));
    stage.addEventListener("pointercancel", (e) => this.release(e));
    stage.addEventListener("wheel", (e) => this.wheel(e), { passive: false });
    stage.addEventListener("dblclick", (e) => this.recentre(e));
    stage.addEventListener("contextmenu", (e) => e.preventDefault());
    this.stage.addEventListener("keydown", (e) => this.key(e));
  }

  press(event) {
    this.stage.focus();
    this.canvas.setPointerCapture(event.pointerId);
    this.dragged = { x: event.clientX, y: event.clientY, way: 0, isPan: event.button > 0 || event.shiftKey || this.facts?.kind === "plane" };
  }

  drag(event) {
    const ratio = window.devicePixelRatio || 1;
    const dx = event.clientX - this.dragged.x, dy = event.clientY - this.dragged.y;
    Object.assign(this.dragged, { x: event.clientX, y: event.clientY, way: this.dragged.way + Math.abs(dx) + Math.abs(dy) });
    if (this.dragged.way < 4 || !this.picture) return;
    const isFree = this.freeButton.ariaPressed === "true";
    const angle = Math.PI / (this.canvas.clientHeight || 1);
    this.look((camera) => this.dragged.isPan ? pan(camera, dx * ratio, dy * ratio, this.pixels())
      : orbit(camera, this.centre ?? camera.at, dx * angle, dy * angle, isFree), true);
  }

  release(event) {
    const drag = this.dragged;
    this.dragged = null;
    if (!drag) return;
    if (drag.way < 4) this.click(event);
    else this.look((camera) => camera);
  }

  wheel(event) {
    event.preventDefault();
    if (!this.picture) return;
    const [x, y] = this.place(event), [, , width, height] = this.picture.image;
    const factor = Math.exp(Math.max(-60, Math.min(60, event.deltaY)) / 400);
    this.dragged = null;
    this.look((camera) => zoom(camera, factor, x - width / 2, y - height / 2, height), true);
    clearTimeout(this.rolling);
    this.rolling = setTimeout(() => this.look((camera) => camera), 150);
  }

  async recentre(event) {
    const found = await this.pick(event);
    if (!found?.position) return;
    this.centre = found.position;
    this.look((camera) => {
      const { forward } = frameOf(camera, 1);
      const offset = minus(found.position, camera.at);
      const step = minus(offset, times(dot(offset, forward), forward));
      return { ...camera, eye: plus(camera.eye, step), at: plus(camera.at, step) };
    });
  }

  key(event) {
    if (event.target !== this.stage) return;
    const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    const isPan = event.shiftKey || this.facts?.kind === "plane";
    if (way) this.look((camera) => isPan ? pan(camera, way[0] * 40, way[1] * 40, this.pixels())
      : orbit(camera, this.centre ?? camera.at, way[0] * STEP, way[1] * STEP, this.freeButton.ariaPressed === "true"));
    else if (event.key === "+" || event.key === "=") this.look((camera) => zoom(camera, 0.8, 0, 0, this.pixels()));
    else if (event.key === "-") this.look((camera) => zoom(camera, 1.25, 0, 0, this.pixels()));
    else if (event.key === "f") this.fit();
    else if (event.key === "z" && (event.ctrlKey || event.metaKey)) this.model.send({ type: "undo" });
    else if (event.key === "y" && (event.ctrlKey || event.metaKey)) this.model.send({ type: "redo" });
    else return;
    event.preventDefault();
  }

  // ---- values

  async pick(event) {
    const [column, row] = this.place(event).map(Math.floor);
    try {
      return await this.ask("pick", { row, column });
    } catch (error) {
      return null;
    }
  }

  async hover(event) {
    if (this.isPicking || !this.picture?.final) return;
    this.isPicking = true;
    const found = await this.pick(event);
    this.isPicking = false;
    this.tell(found);
  }

  tell(found) {
    if (!found || found.element < 0) {
      this.values.textContent = "";
      return;
    }
    const place = found.position.map(String).join(", ");
    const more = (found.order ?? null) === null ? "" : `  order ${found.order}  Jacobian ${found.jacobian}`;
    this.values.textContent = `${found.field} = ${found.value ?? "not a number"}  at (${place})  element ${found.element}${more}  ${found.status}`;
  }

  setMode(mode) {
    this.mode = mode;
    this.line = [];
    this.lineButton.ariaPressed = String(mode === "line");
  }

  async click(event) {
    const found = await this.pick(event);
    this.tell(found);
    if (this.mode !== "line" || !found?.position) return;
    this.line.push(found.position);
    if (this.line.length < 2) return;
    const [start, end] = this.line;
    this.setMode("turn");
    try {
      this.plot(await this.ask("line", { start, end, quantities: [this.picture.field] }));
    } catch (error) {
      this.fail({ text: error.message });
    }
  }

  plot({ names, points, values, elements }) {
    const [width, height, left, top, right, bottom] = [640, 320, 70, 14, 14, 34];
    const along = points.map((point) => length(minus(point, points[0])));
    const own = values[0].filter((value) => value !== null);
    const [low, high] = [Math.min(...own), Math.max(...own)];
    const x = (s) => left + ((width - left - right) * s) / (along.at(-1) || 1);
    const y = (v) => top + ((height - top - bottom) * (high - v)) / (high - low || 1);
    let path = "", pen = "M";
    values[0].forEach((value, i) => {
      if (value === null) pen = "M";
      else { path += `${pen}${x(along[i]).toFixed(2)} ${y(value).toFixed(2)}`; pen = "L"; }
    });
    const ns = "http://www.w3.org/2000/svg";
    const shape = (tag, attributes, text = "") => {
      const element = document.createElementNS(ns, tag);
      for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
      element.textContent = text;
      return element;
    };
    const svg = shape("svg", { viewBox: `0 0 ${width} ${height}`, width, height, role: "img" });
    svg.append(shape("path", { d: `M${left} ${top}V${height - bottom}H${width - right}`, fill: "none", stroke: "currentColor" }),
      shape("path", { d: path, fill: "none", stroke: "#1f77b4", "stroke-width": 2 }),
      ...[low, high].map((value) => shape("text", { x: left - 6, y: y(value) + 4, "text-anchor": "end", "font-size": 12, fill: "currentColor" }, short(value))),
      ...[0, along.at(-1)].map((value) => shape("text", { x: x(value), y: height - 14, "text-anchor": "middle", "font-size": 12, fill: "currentColor" }, short(value))),
      shape("text", { x: (left + width) / 2, y: height - 2, "text-anchor": "middle", "font-size": 12, fill: "currentColor" }, `distance; ${names[0]}`));
    const rows = points.map((point, i) => [along[i], ...point, elements[i], ...values.map((one) => one[i] ?? "NaN")].join(","));
    const csv = ["distance,x,y,z,element," + names.map((name) => `"${name.replaceAll('"', '""')}"`).join(","), ...rows, ""].join("\n");
    const link = make("a", { href: URL.createObjectURL(new Blob([csv], { type: "text/csv" })), download: "line.csv" }, "CSV");
    const close = make("button", { type: "button", onclick: () => this.dialog.close() }, "close");
    this.dialog.replaceChildren(svg, make("div", { className: "elvis-buttons" }, link, close));
    this.dialog.showModal();
  }

  // ---- what is shown, and how

  controls() {
    if (!this.schema || !this.facts || this.panel.contains(document.activeElement) && document.activeElement.type === "range") return;
    const check = (text) => this.ask("check", text).then(() => null, (error) => error.message);
    const make_ = new Controls(this.schema, this.facts, this.palettes, check);
    const section = (title, names) => [make("h2", {}, title), ...names.map((name) =>
      make_.row(name, this.schema.properties[name], this.table[name], (value, moving) => this.change({ [name]: value ?? null }, moving)))];
    const scroll = this.panel.scrollTop, focused = this.panel.contains(document.activeElement) ? this.index(document.activeElement) : -1;
    this.panel.replaceChildren(...this.objects(make_), ...section("Colour", COLOUR), ...section("Light", LIGHT), ...section("Figure", FIGURE));
    this.panel.scrollTop = scroll;
    if (focused >= 0) this.panel.querySelectorAll("input,select,button,summary")[focused]?.focus();
  }

  index(element) {
    return [...this.panel.querySelectorAll("input,select,button,summary")].indexOf(element);
  }

  // the shortcut `plane` is the first object
  listed() {
    const own = this.table.objects ?? [];
    const first = this.table.plane ? [{ key: "plane", item: { kind: "cut", surface: this.table.plane } }] : [];
    return [...first, ...own.map((item, i) => ({ key: `objects[${i}]`, item, number: i }))];
  }

  objects(controls) {
    const items = this.schema.properties.objects.items;
    const schemaOf = (kind) => controls.resolve({ $ref: items.discriminator.mapping[kind] });
    const rows = this.listed().map(({ key, item, number }) => {
      const set = (value, moving) => this.change({ [key]: key === "plane" ? value.surface : value }, moving);
      const button = (text, title, act) => make("button", { type: "button", title, onclick: act }, text);
      const buttons = make("div", { className: "elvis-buttons" }, button("hide", "Take it out of the picture, and keep it", () => { this.hidden.push(item); this.change({ [key]: null }); }));
      if (number !== undefined) buttons.append(button("duplicate", "The same once more", () => this.add(item)));
      buttons.append(button("delete", "Take it away", () => this.change({ [key]: null })));
      return controls.fold(`${key} ${item.kind}`, this.summary(item), [buttons, ...this.sliders(item, set), ...controls.rows(schemaOf(item.kind), item, set)], true);
    });
    const hidden = this.hidden.map((item, i) => make("div", { className: "elvis-buttons" }, `${item.kind} ${this.summary(item)}`,
      make("button", { type: "button", onclick: () => { this.hidden.splice(i, 1); this.add(item); } }, "show")));
    const kinds = this.facts.kind === "solid" ? ["cut", "sphere", "cylinder", "faces", "isosurface", "volume", "clip"] : ["faces"];
    const adding = make("select", { "aria-label": "add an object", onchange: (e) => { if (e.target.selectedIndex) this.create(e.target.value, controls); e.target.selectedIndex = 0; } },
      make("option", {}, "add…"), ...kinds.map((kind) => make("option", {}, kind)));
    const clips = (this.table.clip ?? []).length ? [controls.row("clip", this.schema.properties.clip, this.table.clip, (value) => this.change({ clip: value.length ? value : null }))] : [];
    return [make("h2", {}, "Objects"), ...rows, ...hidden, ...clips, adding];
  }

  summary(item) {
    const values = item.values ?? item.transfer?.values;
    const parts = [item.surface?.kind, item.quantity, values?.map(short).join(", "), item.select?.join(", "), item.style?.quantity];
    return parts.filter(Boolean).join(" ");
  }

  // planes move along their normals, isosurfaces through the range of their quantity
  sliders(item, set) {
    const box = this.facts.box;
    if (item.surface?.kind === "plane" && box) {
      const normal = unit(item.surface.normal), point = item.surface.point;
      const corners = [0, 1, 2, 3, 4, 5, 6, 7].map((k) => dot(normal, [0, 1, 2].map((axis) => box[(k >> axis) & 1][axis])));
      const [low, high] = [Math.min(...corners), Math.max(...corners)], at = dot(normal, point);
      const move = (e, moving) => set({ ...item, surface: { ...item.surface, point: plus(point, times(Number(e.target.value) - at, normal)) } }, moving);
      return [this.slider("offset", low, high, at, move)];
    }
    const range = item.kind === "isosurface" && this.ranges?.[item.quantity ?? this.picture?.field];
    if (item.kind === "isosurface" && item.values?.length === 1) {
      const known = range || this.picture?.ranges?.[item.quantity ?? this.picture?.field] || [item.values[0] - 1, item.values[0] + 1];
      return [this.slider("value", Math.min(known[0], item.values[0]), Math.max(known[1], item.values[0]), item.values[0],
        (e, moving) => set({ ...item, values: [Number(e.target.value)] }, moving))];
    }
    return [];
  }

  slider(name, low, high, value, move) {
    const id = `elvis-${++counter}`;
    return make("div", { className: "elvis-row" }, make("label", { htmlFor: id }, name),
      make("input", { id, type: "range", min: low, max: high, step: (high - low) / 500 || 1, value,
        oninput: (e) => move(e, true), onchange: (e) => { e.target.blur(); move(e, false); } }));
  }

  add(item) {
    this.change({ [`objects[${(this.table.objects ?? []).length}]`]: item });
  }

  create(kind, controls) {
    const field = this.picture?.field || this.facts.fields[0] || "x";
    const range = this.picture?.ranges?.[field] ?? [0, 1];
    const middle = (range[0] + range[1]) / 2;
    const surfaces = { cut: "Plane", sphere: "Sphere", cylinder: "Cylinder", clip: "Plane" };
    const surface = kind in surfaces ? { kind: surfaces[kind].toLowerCase(), ...controls.start(this.schema.$defs[surfaces[kind]]) } : null;
    if (kind === "clip") this.change({ [`clip[${(this.table.clip ?? []).length}]`]: { surface: { ...surface, normal: [1, 0, 0] } } });
    else if (surface) this.add({ kind: "cut", surface });
    else if (kind === "faces") this.add({ kind: "faces", select: ["all"] });
    else if (kind === "isosurface") this.add({ kind: "isosurface", values: [middle] });
    else this.add({ kind: "volume", transfer: { values: [range[0], middle, range[1]], densities: [0, 0, 4 / controls.extent()] } });
  }

  // ---- files

  async save(select) {
    const chosen = select.value;
    select.selectedIndex = 0;
    if (chosen.startsWith("copy")) {
      await navigator.clipboard.writeText(chosen === "copy command" ? this.command() : this.python());
      return;
    }
    const suffix = `.${chosen.split(".").pop()}`;
    try {
      const file = await this.model.file(suffix, this);
      make("a", { href: URL.createObjectURL(file), download: `elvis${suffix}` }).click();
    } catch (error) {
      this.fail({ text: error.message });
    }
  }

  command() {
    return "elvis render scene.toml -o picture.png   # with the scene saved as scene.toml";
  }

  python() {
    return `from elvis.renderer import render\nfrom elvis.scene.tables import scene_of\n\nframe = render(scene=scene_of(${JSON.stringify({ ...this.table, camera: this.picture?.camera })}))`;
  }
}

// ---------------------------------------------------------------- a notebook's model, in the form of anywidget

class Notebook {
  constructor(model) {
    this.model = model;
  }

  on(handler) {
    this.handler = (message, buffers) => handler(message, buffers?.[0]);
    this.model.on("msg:custom", this.handler);
  }

  open() {
    this.send({ type: "hello" });
  }

  send(message) {
    this.model.send(message);
  }

  async file(suffix, viewer) {
    const content = await viewer.ask("save", null, { suffix });
    return new Blob([content]);
  }

  close() {
    this.model.off("msg:custom", this.handler);
  }
}

function render({ model, el }) {
  const own = new Notebook(model);
  const viewer = new Viewer(own, el);
  viewer.root.style.height = `${model.get("height")}px`;
  return () => own.close();
}

export default { render };

// ---------------------------------------------------------------- the page's own model: a socket that comes back

class Socket {
  constructor() {
    this.token = new URLSearchParams(location.search).get("token") ?? "";
    this.delay = 250;
  }

  address(path) {
    const url = new URL(path, location.href);
    url.searchParams.set("token", this.token);
    return url.href;
  }

  async file(suffix) {
    const answer = await fetch(this.address(`save/elvis${suffix}`));
    if (!answer.ok) throw new Error(await answer.text());
    return answer.blob();
  }

  on(handler) {
    this.handler = handler;
  }

  open() {
    this.socket = new WebSocket(this.address("socket").replace(/^http/, "ws"));
    this.socket.binaryType = "arraybuffer";
    this.socket.onopen = () => { this.delay = 250; };
    this.socket.onmessage = ({ data }) => {
      if (typeof data === "string") this.handler(JSON.parse(data));
      else {
        const size = new DataView(data).getUint32(0, true);
        const facts = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, size)));
        this.handler({ type: "frame", ...facts }, new Uint8Array(data, 4 + size));
      }
    };
    this.socket.onclose = () => {
      this.handler({ type: "closed", text: "The connection is lost; the page tries again. Is elvis view still running?" });
      setTimeout(() => this.open(), this.delay);
      this.delay = Math.min(8000, 2 * this.delay);
    };
  }

  send(message) {
    if (this.socket?.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(message));
  }
}

if (document.body?.classList.contains("elvis-page")) {
  window.elvis = new Viewer(new Socket(), document.body);
}
