// The viewer: one module for the page that `elvis view` serves and for notebooks (the form of anywidget).
// A model sends JSON and receives {type: "schema" | "state" | "frame" | "answer" | "error", …}, pictures as buffers.

// ---------------------------------------------------------------- vectors

const plus = (a, b) => a.map((x, i) => x + b[i]);
const minus = (a, b) => a.map((x, i) => x - b[i]);
const times = (s, a) => a.map((x) => s * x);
const dot = (a, b) => a.reduce((sum, x, i) => sum + x * b[i], 0);
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const length = (a) => Math.hypot(...a);
const unit = (a) => times(1 / (length(a) || 1), a);

// Rodrigues' formula: v rotated about a unit axis
function turned(v, axis, angle) {
  const c = Math.cos(angle), s = Math.sin(angle);
  return plus(plus(times(c, v), times(s, cross(axis, v))), times((1 - c) * dot(axis, v), axis));
}

// ---------------------------------------------------------------- cameras

// right, up and forward directions of a camera, and world units of a pixel in the plane through its target
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

// zoom about the point under the pointer, x and y pixels from the middle
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

// column and row on the image of a point in world coordinates, and world units of a pixel there
function seenAt(camera, point, [width, height]) {
  const { right, up, forward, pixel, distance } = frameOf(camera, height);
  const offset = minus(point, camera.eye);
  const own = camera.fov ? (pixel * dot(offset, forward)) / distance : pixel;
  return { x: width / 2 + dot(offset, right) / own, y: height / 2 - dot(offset, up) / own, pixel: own };
}

// start and unit direction of the ray through a position on the image
function rayThrough(camera, x, y, [width, height]) {
  const { right, up, forward, pixel, distance } = frameOf(camera, height);
  const aside = plus(times((x - width / 2) * pixel, right), times((height / 2 - y) * pixel, up));
  const start = camera.fov ? camera.eye : plus(camera.eye, aside);
  return { start, way: unit(camera.fov ? plus(times(distance, forward), aside) : forward) };
}

// whether a scene's camera is independent of what is visible
const isFixed = (camera) => Boolean(camera?.fov || camera?.height);

const plain = ({ eye, at, up, fov, height }) => (fov ? { eye, at, up, fov } : { eye, at, up, height });

// ---------------------------------------------------------------- helpers of the page

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

// an SVG element
function shape(tag, attributes = {}, text = "") {
  const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.textContent = text;
  return element;
}

// value in a scene's table at a dotted key
const valueAt = (table, key) => key.split(/[.[\]]+/).filter(Boolean).reduce((value, step) => value?.[step], table);

const short = (value) => (typeof value === "number" ? String(Number(value.toPrecision(6))) : String(value));
// a number with as many digits as fit into a field
function brief(value) {
  const texts = [7, 6, 5, 4, 3].map((digits) => String(Number(value.toPrecision(digits))));
  return texts.find((text) => text.length <= 9) ?? texts.at(-1);
}

const words = (name) => name.replaceAll("_", " ");
let counter = 0;

// up to seven values in a range, in steps of 1, 2 or 5 times a power of ten; the ends of the range if it is too narrow
function roundValues(low, high) {
  const span = high - low, power = 10 ** Math.floor(Math.log10(span / 7));
  const step = [1, 2, 5, 10, 20].map((factor) => factor * power).find((one) => span / one <= 7);
  if (!(span > 1e-9 * Math.max(Math.abs(low), Math.abs(high))) || !step) return low === high ? [low] : [low, high];
  const begin = Math.ceil(low / step - 1e-9), count = Math.floor(high / step + 1e-9) - begin + 1;
  return Array.from({ length: count }, (_, i) => (begin + i) * step);
}

// names of boundaries after one was ticked or unticked: "all" excludes the others and replaces an empty list
function ticked(names, name, isTicked) {
  const others = names.filter((one) => one !== name && one !== "all");
  if (!isTicked) return others.length ? others : ["all"];
  return name === "all" ? ["all"] : [...others, name];
}

// ---------------------------------------------------------------- controls, generated from the schema of scenes

const QUANTITIES = new Set(["field", "quantity", "expression"]);
//: settings of streamlines in the parts of their panel; all others are advanced
const LINES = { seeds: ["direction", "wall", "velocity"], look: ["radius", "width", "ribbon", "across", "arrows", "arrows_by", "arrow_length", "style"] };
//: kinds of seeds, and the fields of their texts
const SEEDS = { random: [["count", "count"], ["low", "point"], ["high", "point"]], line: [["from", "point"], ["to", "point"], ["count", "count"]], plane: [["point", "point"], ["normal", "point"], ["count", "count"]],
  boundary: [["name", "boundary"], ["count", "count"]], point: [["point", "point"]], elements: [] };
//: room around a body in which new lines start: relative to its side along each axis, and at least to its longest side
const NEARBY = 0.25, LEAST_NEARBY = 0.1;
//: contours that are added
const TEN_LINES = { count: 10 };
//: settings that exclude each other in an object
const EITHER = [["radius", "width", "ribbon"], ["values", "count"]];
//: parts of a style that are drawn only on surfaces
const ON_SURFACES = new Set(["contours", "mesh_lines", "lic"]);
//: cosines of directions that count as equal if they differ by less than this
const NEARLY = 0.05;
const OPTIONAL = (schema) => schema.anyOf?.some((one) => one.type === "null");

class Controls {
  constructor(schema, facts, palettes, check) {
    Object.assign(this, { schema, facts, palettes, check });
  }

  resolve(schema) {
    return schema.$ref ? { ...this.schema.$defs[schema.$ref.split("/").pop()], description: schema.description } : schema;
  }

  // a valid initial value of a setting
  start(schema, key) {
    const own = this.resolve(schema);
    const usual = {
      point: this.middle(), center: this.middle(), apex: this.middle(), normal: this.axis(), axis: this.axis(),
      radius: this.extent() / 4, angle: 30, expression: this.facts?.fields?.[0] ?? "x", values: [0], count: 10,
      contours: TEN_LINES, range: this.facts?.range ?? [0, 1], densities: [0, 1], file: "surface.stl", direction: [1, 1, 1], linear: 1e-3,
      across: this.axis(), length: this.extent(), arrows: this.extent() / 10, arrow_length: this.extent() / 40, ribbon: this.extent() / 50,
      tolerance: 1e-6, font_size: 12, ambient: 0.5, at: this.middle(), text: "text", step: [this.extent(), 0, 0],
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
      return Object.assign(kind, Object.fromEntries(needed.map((name) => [name, this.start(own.properties[name], name)])));
    }
    // the initial value of a number with exclusive limits lies between them
    const { exclusiveMinimum: above } = own;
    const number = above === undefined ? 1 : (above + (own.exclusiveMaximum ?? own.maximum ?? above + 2)) / 2;
    return { number: own.minimum ?? number, integer: own.minimum ?? 1, boolean: false, string: "", array: [] }[own.type];
  }

  // box of what was visible when an object was added, else of all data
  get box() {
    return this.facts?.seen ?? this.facts?.box;
  }

  // where new objects are placed: at an extremum that was found, else in the middle of what is visible
  middle() {
    return this.facts?.place ?? (this.box ? times(0.5, plus(...this.box)) : [0, 0, 0]);
  }

  extent(box = this.box) {
    return box ? length(minus(box[1], box[0])) : 1;
  }

  // a box around the bodies in a far field, else around what is visible, in which lines start; null for all data
  nearby() {
    const { body_box: bodies, box } = this.facts ?? {}, own = bodies ?? this.box;
    if (!own || !box) return null;
    const sides = minus(own[1], own[0]), longest = Math.max(...sides);
    const room = sides.map((side) => Math.max(NEARBY * side, LEAST_NEARBY * longest));
    // without rounding next to zero
    const rounded = (x) => (Math.abs(x) < 1e-12 * longest ? 0 : x);
    const low = own[0].map((x, i) => rounded(Math.max(x - room[i], box[0][i]))), high = own[1].map((x, i) => rounded(Math.min(x + room[i], box[1][i])));
    const isAll = low.every((x, i) => x === rounded(box[0][i]) && high[i] === rounded(box[1][i]));
    return isAll ? null : [low, high];
  }

  // the axis closest to the viewing direction; of several, the one along which most is visible
  axis() {
    const { forward } = this.facts ?? {};
    if (!forward) return [0, 0, 1];
    const sides = this.box ? minus(this.box[1], this.box[0]) : [0, 0, 0];
    const nearest = Math.max(...forward.map(Math.abs));
    const equal = [0, 1, 2].filter((i) => Math.abs(forward[i]) > nearest - NEARLY);
    const chosen = equal.reduce((best, i) => (sides[i] > sides[best] ? i : best));
    return [0, 1, 2].map((i) => Number(i === chosen));
  }

  // a labelled control of a setting; set(value, isMoving), value undefined for the default
  row(key, schema, value, set) {
    const own = this.resolve(schema);
    const id = `elvis-${++counter}`;
    const control = this.control(key, own, value, set, id);
    if (control.tagName === "DETAILS") return control;
    const label = make("label", { htmlFor: id, title: own.description ?? "" }, words(key));
    const isVector = own.prefixItems?.length > 2 && key !== "color";
    return make("div", { className: isVector ? "elvis-row elvis-wide" : "elvis-row" }, label, control);
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
    if (own.type === "number" || own.type === "integer") return this.number(key, own, value ?? own.default, set, id);
    return this.text(key, value ?? own.default ?? "", set, id);
  }

  number(key, own, value, set, id) {
    const [low, high] = [own.minimum ?? own.exclusiveMinimum, own.maximum];
    const field = make("input", { id, type: "number", step: own.type === "integer" ? 1 : "any", value: value ?? "",
      onchange: (e) => e.target.value !== "" && set(Number(e.target.value)) });
    if (low === undefined || high === undefined || own.type === "integer") return field;
    const slider = make("input", { type: "range", min: low, max: high, step: (high - low) / 200, value: value ?? low,
      "aria-label": `${words(key)} slider`, oninput: (e) => { field.value = e.target.value; set(Math.max(Number(e.target.value), low + (own.exclusiveMinimum === low ? 0.005 : 0)), true); },
      onchange: (e) => set(Math.max(Number(e.target.value), low + (own.exclusiveMinimum === low ? 0.005 : 0))) });
    return make("div", { className: "elvis-several" }, slider, field);
  }

  numbers(key, own, value, set, id) {
    if (key === "color") return this.color(value, set, id);
    const current = [...(value ?? own.prefixItems.map(() => 0))];
    const put = (i, e) => {
      current[i] = Number(e.target.value);
      e.target.title = e.target.value;
      set([...current]);
    };
    // a field that is not edited preserves all digits of its number, which its tooltip shows
    const fields = current.map((one, i) => make("input", { id: i ? "" : id, type: "number", step: "any", value: brief(one), title: String(one),
      "aria-label": `${key} ${i + 1}`, onchange: (e) => put(i, e) }));
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
    const chapters = key === "palette" ? { "colour maps": this.palettes } : QUANTITIES.has(key) ? this.facts?.quantities ?? {} : null;
    const usual = QUANTITIES.has(key) ? this.facts?.shown ?? "" : "";
    const field = make("input", { id, type: "text", value, spellcheck: false, placeholder: usual,
      onchange: (e) => set(e.target.value === "" ? undefined : e.target.value) });
    if (!chapters) return field;
    // all names by chapter, and those that contain the typed text
    const names = Object.values(chapters).flat(), known = make("datalist", { id: `${id}-known` }, ...names.map((name) => make("option", { value: name })));
    field.setAttribute("list", known.id);
    const choose = (e) => e.target.selectedIndex && set(names[e.target.selectedIndex - 1]);
    const groups = Object.entries(chapters).filter(([, own]) => own.length).map(([label, own]) => make("optgroup", { label }, ...own.map((name) => make("option", {}, name))));
    const listed = make("select", { className: "elvis-names", "aria-label": `names: ${words(key)}`, title: "Names to choose from", onchange: choose },
      make("option", {}, ""), ...groups);
    const note = make("div", { className: "elvis-note" });
    if (QUANTITIES.has(key)) {
      field.addEventListener("input", async () => {
        const answer = field.value ? await this.check(field.value) : null;
        field.classList.toggle("elvis-invalid", Boolean(answer));
        note.textContent = answer ?? "";
      });
    }
    return make("div", {}, make("div", { className: "elvis-several" }, field, listed, known), note);
  }

  list(key, own, value, set, id) {
    const isText = own.items?.type === "string";
    if (own.items && !["number", "string", "integer"].includes(own.items.type)) return this.items(key, own, value, set);
    const read = (text) => text.split(/[\s,;]+/).filter(Boolean).map((one) => (isText ? one : Number(one)));
    const field = make("input", { id, type: "text", value: value.map(short).join(", "), spellcheck: false,
      onchange: (e) => set(read(e.target.value)) });
    const { boundaries = [], kind, contents } = this.facts ?? {};
    const parts = kind === "plane" ? Object.keys(contents?.regions ?? {}).map((name) => `region:${name}`) : boundaries;
    if (key !== "select" || !parts.length) return field;
    const boxes = ["all", ...parts].map((name) => make("label", {}, make("input", { type: "checkbox", checked: value.includes(name),
      onchange: (e) => set(ticked(value, name, e.target.checked)) }), ` ${name} `));
    return make("div", {}, field, ...boxes);
  }

  items(key, own, value, set) {
    const rows = value.map((one, i) => {
      const take = (next, moving) => set(value.map((old, k) => (k === i ? next : old)), moving);
      const remove = make("button", { type: "button", title: `Remove`, onclick: () => set(value.filter((_, k) => k !== i)) }, "×");
      return make("div", { className: "elvis-item" }, this.control(`${key} ${i + 1}`, this.resolve(own.items), one, take, `elvis-${++counter}`), remove);
    });
    const add = make("button", { type: "button", onclick: () => set([...value, this.start(own.items, key)]) }, `add`);
    return this.fold(key, "", [...rows, add], false);
  }

  optional(key, own, value, set, id) {
    const inner = this.resolve(own.anyOf.find((one) => one.type !== "null"));
    const isSet = value !== undefined && value !== null;
    if (inner.oneOf?.some((one) => one.enum)) return this.alternatives(key, { ...inner, names: ["default"] }, value ?? "default", set, id);
    if (inner.type === "string" && !inner.enum) return this.text(key, value ?? "", set, id);
    const box = make("input", { id, type: "checkbox", checked: isSet, "aria-label": words(key),
      onchange: (e) => set(e.target.checked ? this.start(own, key) : undefined) });
    if (!isSet) return make("label", { className: "elvis-several elvis-own" }, box, "set");
    const control = this.control(key, inner, value, set, `${id}-own`);
    return control.tagName === "DETAILS" ? this.fold(key, "", [make("label", {}, box, ` ${words(key)}`), ...control.lastChild.childNodes], true)
      : make("div", { className: "elvis-several" }, box, control);
  }

  alternatives(key, own, value, set, id) {
    const named = own.oneOf.find((one) => one.enum);
    const other = own.oneOf.find((one) => !one.enum);
    const names = [...(own.names ?? []), ...(named?.enum ?? [])];
    const start = { "own values": () => this.start(other, key), default: () => undefined };
    if (typeof value === "string" || value === undefined) {
      return this.choice([...names, "own values"], value ?? own.default, (one) => set(start[one] ? start[one]() : one), id);
    }
    const back = make("button", { type: "button", title: `Back to ${names[0] ?? "the default"}`, onclick: () => set(names[0] === "default" ? undefined : names[0]) }, "×");
    return make("div", { className: "elvis-several" }, this.control(key, this.resolve(other), value, set, id), back);
  }

  variants(key, own, value, set) {
    // planes through the middle become planes as soon as the data are known
    const kinds = Object.keys(own.discriminator.mapping).filter((kind) => kind !== "middle");
    const schemaOf = (kind) => this.resolve({ $ref: own.discriminator.mapping[kind] });
    const select = this.choice(kinds, value.kind, (kind) => set(this.start(schemaOf(kind), key)), `elvis-${++counter}`);
    return this.fold(key, value.kind, [select, ...this.rows(schemaOf(value.kind), value, set)], true);
  }

  group(key, own, value, set) {
    return this.fold(key, "", this.rows(own, value, set), false);
  }

  rows(own, value, set) {
    if (value.kind === "streamlines") return this.streamlines(own, value, set);
    const names = Object.keys(own.properties).filter((name) => name !== "kind" && !this.hidden?.has(name));
    return this.rowsOf(names, own, value, set);
  }

  rowsOf(names, own, value, set) {
    return names.map((name) => [name, own.properties[name]]).map(([name, one]) =>
      this.row(name, one, value[name], (next, moving) => {
        const { [name]: _, ...rest } = value;
        if (next !== undefined) for (const other of EITHER.find((names) => names.includes(name)) ?? []) delete rest[other];
        set(next === undefined ? rest : { ...rest, [name]: next }, moving);
      }));
  }

  // settings of streamlines: where they start, how they look, and all others
  streamlines(own, value, set) {
    const others = Object.keys(own.properties).filter((name) => !["kind", "seeds", ...LINES.seeds, ...LINES.look].includes(name));
    const rows = (names) => this.rowsOf(names, own, value, set);
    const seeds = value.seeds ?? [];
    const put = (next) => set({ ...value, seeds: next });
    const add = make("button", { type: "button", onclick: () => put([...seeds, this.seedText("random")]) }, "add seeds");
    const lists = seeds.map((text, i) => this.seeds(text, (next) => put(seeds.map((old, k) => (k === i ? next : old))), seeds.length > 1 ? () => put(seeds.filter((_, k) => k !== i)) : null));
    return [this.fold("seeds", "", [...lists, add, ...rows(LINES.seeds)], true), this.fold("look", "", rows(LINES.look), true), this.fold("advanced", "", rows(others), false)];
  }

  // one text of seeds as its kind and fields; other texts stay texts
  seeds(text, put, remove) {
    const [kind, ...parts] = /^\d+$/.test(text) ? ["random", text] : text.split(":");
    const fields = SEEDS[kind], isKnown = fields && (fields.length === parts.length || (kind === "random" && parts.length === 1));
    const kinds = isKnown ? Object.keys(SEEDS) : [text, ...Object.keys(SEEDS)];
    const choice = this.choice(kinds, isKnown ? kind : text, (one) => put(this.seedText(one)), `elvis-${++counter}`);
    choice.ariaLabel = "kind of seeds";
    const gone = remove && make("button", { type: "button", title: "Remove these seeds", ariaLabel: "remove these seeds", onclick: remove }, "×");
    const rows = (isKnown ? fields.slice(0, parts.length) : []).map(([name, type], i) => this.seedField(name, type, parts[i], (next) => put([kind, ...parts.map((old, k) => (k === i ? next : old))].join(":"))));
    return make("div", { className: "elvis-seeds" }, make("div", { className: "elvis-several" }, choice, ...(gone ? [gone] : [])), ...rows);
  }

  seedField(name, type, text, put) {
    const id = `elvis-${++counter}`;
    const controls = {
      point: () => this.numbers(name, {}, text.split(",").map(Number), (point) => put(point.join(",")), id),
      count: () => make("input", { id, type: "number", min: 1, step: 1, value: text, onchange: (e) => e.target.value && put(String(Math.max(1, Math.round(Number(e.target.value))))) }),
      boundary: () => this.choice(this.facts?.boundaries ?? [], text, put, id),
    };
    return make("div", { className: type === "point" ? "elvis-row elvis-wide" : "elvis-row" }, make("label", { htmlFor: id }, name), controls[type]());
  }

  // seeds of a kind where the camera looks
  seedText(kind) {
    const middle = this.middle(), axis = this.axis(), aside = times(this.extent() / 4, [axis[1], axis[2], axis[0]]);
    const point = (place) => place.map((one) => Number(one.toPrecision(6))).join(",");
    const nearby = this.nearby(), random = nearby ? `random:30:${nearby.map(point).join(":")}` : "random:30";
    const texts = { random, line: `line:${point(minus(middle, aside))}:${point(plus(middle, aside))}:20`, plane: `plane:${point(middle)}:${point(axis)}:10`,
      boundary: `boundary:${this.facts?.bodies?.[0] ?? this.facts?.boundaries?.[0] ?? "all"}:2`, point: `point:${point(middle)}`, elements: "elements" };
    return texts[kind] ?? kind;
  }

  fold(key, summary, children, open) {
    const details = make("details", { open },
      make("summary", {}, `${words(key)}${summary ? `: ${summary}` : ""}`), make("div", {}, ...children));
    details.addEventListener("toggle", () => Controls.open.set(foldsAround(details).join("/"), details.open));
    return details;
  }

  // restore the state in which the user left the folds of a panel
  static restore(panel) {
    for (const one of panel.querySelectorAll("details")) one.open = Controls.open.get(foldsAround(one).join("/")) ?? one.open;
  }
}
Controls.open = new Map();

// names of the folds around an element, the innermost first: folds of several objects have the same name
function foldsAround(element) {
  const names = [];
  for (let at = element.closest("details"); at; at = at.parentElement?.closest("details")) names.push(at.firstChild.textContent.split(":")[0]);
  return names;
}

// ---------------------------------------------------------------- handles: planes, spheres, cylinders and cones can be dragged in the picture

const ARROW = 64, APART = 30, ROUND = 72;

// corners of the intersection of a plane and a box, in order around it
function sectionOf(box, point, normal) {
  const corner = (k) => [0, 1, 2].map((axis) => box[(k >> axis) & 1][axis]);
  const heights = [0, 1, 2, 3, 4, 5, 6, 7].map((k) => dot(normal, minus(corner(k), point)));
  const found = [];
  for (let k = 0; k < 8; k++) {
    for (const step of [1, 2, 4]) {
      const other = k | step;
      if (k & step || heights[k] < 0 === heights[other] < 0) continue;
      const part = heights[k] / (heights[k] - heights[other]);
      found.push(plus(times(1 - part, corner(k)), times(part, corner(other))));
    }
  }
  if (found.length < 3) return [];
  const middle = times(1 / found.length, found.reduce(plus));
  const across = unit(minus(found[0], middle)), upwards = cross(normal, across);
  const angle = (one) => Math.atan2(dot(minus(one, middle), upwards), dot(minus(one, middle), across));
  return found.sort((one, other) => angle(one) - angle(other));
}

// the outline of a sphere as seen from a camera
function rimOf(camera, { center, radius }) {
  const { right, up, forward } = frameOf(camera, 1);
  const towards = camera.fov ? minus(camera.eye, center) : times(-1, forward);
  const part = camera.fov ? Math.min(0.999, radius / length(towards)) : 0;
  const axis = unit(towards), own = radius * Math.sqrt(1 - part * part);
  const across = camera.fov ? unit(cross(up, axis)) : right, upwards = cross(axis, across);
  const middle = plus(center, times(radius * part, axis));
  return circle(middle, times(own, across), times(own, upwards));
}

// points of a circle, from its centre and two perpendicular radii
function circle(middle, across, upwards) {
  return Array.from({ length: ROUND }, (_, k) => (2 * Math.PI * k) / ROUND).map((angle) =>
    plus(middle, plus(times(Math.cos(angle), across), times(Math.sin(angle), upwards))));
}

class Handles {
  constructor(viewer) {
    this.viewer = viewer;
    this.svg = shape("svg", { class: "elvis-handles" });
    this.dragged = null;
    this.svg.addEventListener("pointermove", (e) => this.drag(e));
    for (const kind of ["pointerup", "pointercancel"]) this.svg.addEventListener(kind, () => this.release());
  }

  // the surface that is being dragged, or the selected one
  surface() {
    return this.dragged?.surface ?? (this.viewer.selected ? valueAt(this.viewer.table, this.viewer.selected) : null);
  }

  draw() {
    const { picture, facts, canvas, peak } = this.viewer;
    const surface = picture && facts?.kind === "solid" ? this.surface() : null;
    const marks = picture ? this.viewer.plots.marks() : [];
    if (!picture || !(surface || peak || marks.length)) {
      this.svg.replaceChildren();
      return;
    }
    this.camera = { up: [0, 0, 1], ...(this.viewer.warp.camera ?? picture.camera) };
    const [left, top, width, height] = picture.image;
    this.size = [width, height];
    this.svg.setAttribute("viewBox", `${-left} ${-top} ${canvas.width} ${canvas.height}`);
    Object.assign(this.svg.style, { width: canvas.style.width, height: canvas.style.height });
    const drawings = { center: () => this.sphere(surface), normal: () => this.plane(surface), apex: () => this.cone(surface), axis: () => this.cylinder(surface) };
    const kind = Object.keys(drawings).find((name) => surface?.[name]);
    const { cursor } = this.viewer.plots, active = this.svg.getRootNode().activeElement;
    const focused = this.svg.contains(active) ? active.dataset.name : null;
    this.svg.replaceChildren(...marks.flatMap(([color, points]) => this.track(color, points)), ...(cursor ? this.spot(cursor) : []),
      ...(kind ? drawings[kind]() : []), ...(peak ? this.mark(peak) : []));
    if (focused) [...this.svg.children].find((one) => one.dataset.name === focused)?.focus({ preventScroll: true });
  }

  // where the values of a plot come from, in the colour of their curve
  track(color, points) {
    const places = points.map((one) => this.seen(one)), ratio = this.viewer.density;
    if (places.length === 1) return this.spot(points[0], color);
    const text = places.map(({ x, y }) => `${x.toFixed(1)},${y.toFixed(1)}`).join(" ");
    return [["#fff", 4.5], [color, 2]].map(([stroke, width]) => shape("polyline", { points: text, fill: "none", stroke, "stroke-width": width * ratio }));
  }

  spot(point, color = "#d0481a") {
    const { x, y } = this.seen(point), ratio = this.viewer.density;
    return [shape("circle", { cx: x, cy: y, r: 5 * ratio, fill: color, stroke: "#fff", "stroke-width": 1.5 * ratio })];
  }

  // a cross with its value, where a field has its minimum or maximum
  mark({ field, value, position }) {
    const { x, y } = this.seen(position), reach = 9 * this.viewer.density;
    const texts = ["elvis-under", "elvis-over"].map((name) => shape("text", { x: x + 1.5 * reach, y: y - reach, class: name, "font-size": 1.5 * reach }, `${field} = ${short(value)}`));
    return [...this.segment({ x: x - reach, y }, { x: x + reach, y }), ...this.segment({ x, y: y - reach }, { x, y: y + reach }), ...texts];
  }

  seen(point) {
    return seenAt(this.camera, point, this.size);
  }

  outline(points) {
    const text = points.map((one) => this.seen(one)).map(({ x, y }) => `${x.toFixed(1)},${y.toFixed(1)}`).join(" ");
    return ["elvis-under", "elvis-over"].map((name) => shape("polygon", { points: text, class: name }));
  }

  grip(name, title, { x, y }, pull) {
    const ratio = this.viewer.density;
    const grip = shape("circle", { cx: x.toFixed(1), cy: y.toFixed(1), r: 8 * ratio, class: "elvis-grip", tabindex: 0, role: "button", "aria-label": `${title.replace("Drag", "Drag or arrow keys")}` });
    grip.dataset.name = name;
    grip.addEventListener("keydown", (e) => this.key(e, pull));
    grip.append(shape("title", {}, title));
    grip.addEventListener("pointerdown", (e) => this.press(e, pull));
    return grip;
  }

  segment(start, end) {
    const line = { x1: start.x, y1: start.y, x2: end.x, y2: end.y };
    return ["elvis-under", "elvis-over"].map((name) => shape("line", { ...line, class: name }));
  }

  // a point of an infinite surface: its own point if that lies in the box, else another one, in the box if possible
  holdOf(point, other) {
    const box = this.viewer.facts.box;
    const isWithin = !box || point.every((x, i) => x >= box[0][i] && x <= box[1][i]);
    return isWithin ? point : other(times(0.5, plus(...box)));
  }

  // an arrow from a point along a direction, of constant length on the page: its tip, and where that is shown
  arrow(hold, way) {
    const start = this.seen(hold), ratio = this.viewer.density;
    const tip = plus(hold, times(ARROW * ratio * start.pixel, way));
    return { start, tip, end: this.apart(start, this.seen(tip), APART * ratio) };
  }

  plane({ point, normal }) {
    const away = unit(normal), corners = sectionOf(this.viewer.facts.box ?? [point, point], point, away);
    const hold = this.holdOf(point, () => (corners.length ? times(1 / corners.length, corners.reduce(plus)) : point));
    const { start, tip, end } = this.arrow(hold, away);
    const tilt = (dx, dy) => ({ point: hold, normal: this.tilted(hold, tip, dx, dy) });
    const move = (dx, dy) => ({ point: plus(hold, times(this.along(hold, away, dx, dy), away)) });
    return [...this.outline(corners), ...this.segment(start, end), this.grip("tilt", "Drag: tilt the plane", end, tilt),
      this.grip("move", "Drag: move the plane along its normal; with Shift: tilt the plane", start, (dx, dy, { isShift }) => (isShift ? tilt : move)(dx, dy))];
  }

  // a direction perpendicular to an axis and to the view, so that it is never foreshortened
  aside(axis) {
    const { forward, right } = frameOf(this.camera, 1), across = cross(axis, forward);
    return length(across) > 1e-3 ? unit(across) : right;
  }

  cylinder({ point, axis, radius }) {
    const way = unit(axis), box = this.viewer.facts.box ?? [point, point];
    const hold = this.holdOf(point, (middle) => plus(point, times(dot(minus(middle, point), way), way)));
    const { start, tip, end } = this.arrow(hold, way);
    const across = times(radius, this.aside(way)), rim = plus(hold, across), least = 4 * start.pixel;
    // its sides, as far as the box extends
    const half = 0.5 * [0, 1, 2].reduce((sum, i) => sum + Math.abs(way[i]) * (box[1][i] - box[0][i]), 0);
    const sides = [1, -1].flatMap((sign) => this.segment(...[1, -1].map((other) => this.seen(plus(hold, plus(times(sign, across), times(other * half, way)))))));
    return [...sides, ...this.outline(circle(hold, across, cross(way, across))), ...this.segment(start, end),
      this.grip("tilt", "Drag: tilt the cylinder", end, (dx, dy) => ({ point: hold, axis: this.tilted(hold, tip, dx, dy) })),
      this.grip("radius", "Drag: change the radius of the cylinder", this.seen(rim), (dx, dy) => ({ radius: Math.max(least, radius + this.along(rim, unit(across), dx, dy)) })),
      this.grip("move", "Drag: move the cylinder", start, (dx, dy) => ({ point: this.beside(hold, dx, dy) }))];
  }

  cone({ apex, axis, angle }) {
    const way = unit(axis), degree = Math.PI / 180, { start, tip, end } = this.arrow(apex, way);
    // the position of the rim along the axis is fixed during a drag
    const slant = length(minus(tip, apex)) * 2, reach = slant * Math.cos((this.dragged?.start.angle ?? angle) * degree);
    const middle = plus(apex, times(reach, way)), aside = this.aside(way), across = times(reach * Math.tan(angle * degree), aside);
    const rim = plus(middle, across), sides = [1, -1].flatMap((sign) => this.segment(start, this.seen(plus(middle, times(sign, across)))));
    const open = (dx, dy) => Math.atan2(length(across) + this.along(rim, aside, dx, dy), reach) / degree;
    return [...sides, ...this.outline(circle(middle, across, cross(way, across))), ...this.segment(start, end),
      this.grip("tilt", "Drag: tilt the cone", end, (dx, dy) => ({ axis: this.tilted(apex, tip, dx, dy) })),
      this.grip("angle", "Drag: change the angle of the cone", this.seen(rim), (dx, dy) => ({ angle: Math.min(89.5, Math.max(0.5, open(dx, dy))) })),
      this.grip("move", "Drag: move the cone", start, (dx, dy) => ({ apex: this.beside(apex, dx, dy) }))];
  }

  // an end that the start does not hide if an arrow points at the viewer
  apart(start, end, least) {
    const [dx, dy] = [end.x - start.x, end.y - start.y], own = Math.hypot(dx, dy);
    if (own >= least) return end;
    const [x, y] = own > 0.01 * least ? [dx / own, dy / own] : [0, -1];
    return { x: start.x + least * x, y: start.y + least * y };
  }

  // distance by which the pointer has dragged a point along a unit direction: to the point of the line nearest to the pointer's ray;
  // if the direction points at the viewer, vertical motion counts
  along(hold, direction, dx, dy) {
    const begin = this.seen(hold), { start, way } = rayThrough(this.camera, begin.x + dx, begin.y + dy, this.size);
    const share = dot(direction, way), square = 1 - share * share, offset = minus(start, hold);
    return square > 0.03 ? (dot(offset, direction) - share * dot(offset, way)) / square : -dy * begin.pixel;
  }

  // the direction from a point to the dragged tip of its arrow
  tilted(hold, tip, dx, dy) {
    return unit(minus(this.beside(tip, dx, dy), hold));
  }

  // a point moved with the pointer, at constant depth
  beside(point, dx, dy) {
    const { right, up } = frameOf(this.camera, 1), { pixel } = this.seen(point);
    return plus(point, plus(times(dx * pixel, right), times(-dy * pixel, up)));
  }

  sphere(surface) {
    const rim = rimOf(this.camera, surface);
    const side = rim.map((one) => this.seen(one)).reduce((most, one) => (one.x > most.x ? one : most));
    const least = 4 * this.seen(surface.center).pixel;
    return [...this.outline(rim),
      this.grip("radius", "Drag: change the radius of the sphere", side,
        (dx, dy) => ({ radius: Math.max(least, this.missBy(surface.center, side.x + dx, side.y + dy)) })),
      this.grip("center", "Drag: move the sphere", this.seen(surface.center), (dx, dy) => ({ center: this.beside(surface.center, dx, dy) }))];
  }

  // distance of a point from the ray through a position on the image
  missBy(point, x, y) {
    const { start, way } = rayThrough(this.camera, x, y, this.size);
    return length(cross(minus(point, start), way));
  }

  key(event, pull) {
    const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    if (!way) return;
    event.preventDefault();
    event.stopPropagation();
    const [dx, dy] = times(NUDGE * this.viewer.density, way);
    this.send({ key: this.viewer.selected, surface: { ...this.surface(), ...pull(dx, dy, { isShift: event.shiftKey }) } }, false);
  }

  // grips are recreated as they move, so the whole handle captures the pointer
  press(event, pull) {
    event.stopPropagation();
    event.preventDefault();
    this.svg.setPointerCapture(event.pointerId);
    const surface = this.surface();
    this.dragged = { pull, x: event.clientX, y: event.clientY, key: this.viewer.selected, start: surface, surface, isMoved: false };
  }

  drag(event) {
    const own = this.dragged;
    if (!own) return;
    const ratio = this.viewer.density;
    const pulled = own.pull((event.clientX - own.x) * ratio, (event.clientY - own.y) * ratio, { isShift: event.shiftKey });
    own.surface = { ...own.start, ...pulled };
    own.isMoved = true;
    this.draw();
    this.pending ??= requestAnimationFrame(() => {
      this.pending = null;
      if (this.dragged) this.send(this.dragged, true);
    });
  }

  release() {
    const own = this.dragged;
    this.dragged = null;
    if (own?.isMoved) this.send(own, false);
    else this.draw();
  }

  send({ key, surface }, isMoving) {
    this.viewer.change({ [key]: surface, ...this.viewer.still() }, isMoving);
  }
}

// ---------------------------------------------------------------- transfer functions, over the histogram of their quantity

const PLOT = { width: 280, height: 116, foot: 16 };
//: decades of shares of the volume shown below the maximum
const DECADES = 4;

//: largest part of all elements' volume that a new volume shows
const RARE = 1 / 8;

// The transfer function of a new volume, by the shares of the volume in equal parts of the range: the rarer end of the values,
// at most half of the range, so that the rest does not hide it.  It is as dense as suits its size, a part of the extent.
function rareEnd(low, high, shares, extent) {
  const total = shares.reduce((sum, share) => sum + share, 0);
  const mean = shares.reduce((sum, share, i) => sum + share * (i + 0.5), 0) / (shares.length * total);
  const isLow = mean > 0.5, ordered = isLow ? shares : [...shares].reverse();
  let count = 0, seen = 0;
  while (count < shares.length / 2 && seen + ordered[count] <= RARE * total) seen += ordered[count++];
  const part = count ? count / shares.length : 0.5, share = count ? Math.max(seen / total, 1e-3) : 1;
  const start = isLow ? low + part * (high - low) : high - part * (high - low), density = 8 / (extent * Math.cbrt(share));
  return { values: [low, start, high], densities: isLow ? [density, 0, 0] : [0, 0, density] };
}

class TransferEditor {
  // set(transfer, isMoving)
  constructor(transfer, histogram, extent, set) {
    Object.assign(this, { transfer, histogram, set });
    const { values, densities } = transfer;
    const lows = [values[0], histogram?.low ?? values[0]], highs = [values.at(-1), histogram?.high ?? values.at(-1)];
    this.low = Math.min(...lows);
    this.high = Math.max(...highs, this.low + 1e-12 * Math.abs(this.low) + Number.MIN_VALUE);
    this.top = 1.25 * Math.max(...densities) || 8 / extent;
    this.svg = shape("svg", { viewBox: `0 0 ${PLOT.width} ${PLOT.height}`, class: "elvis-transfer", role: "group", "aria-label": "transfer function" });
    this.svg.addEventListener("dblclick", (e) => this.twice(e));
    this.svg.addEventListener("pointermove", (e) => this.drag(e));
    for (const kind of ["pointerup", "pointercancel"]) this.svg.addEventListener(kind, () => this.release());
    this.draw();
  }

  get element() {
    const { histogram } = this;
    const note = histogram ? `Grey: histogram by volume, logarithmic over ${DECADES} decades, from the quadrature's ${histogram.sample}.` : "";
    const help = "Drag a point to move it; double-click to add or remove one. Keys: arrows move, Enter adds a point after it, Delete removes it.";
    return make("div", { title: help }, this.svg, make("div", { className: "elvis-aside" }, note));
  }

  x(value) { return (PLOT.width * (value - this.low)) / (this.high - this.low); }
  y(density) { return (PLOT.height - PLOT.foot) * (1 - density / this.top); }

  // value and density at the pointer
  under(event) {
    const box = this.svg.getBoundingClientRect();
    const [x, y] = [(event.clientX - box.left) / box.width, ((event.clientY - box.top) / box.height) * PLOT.height];
    const density = this.top * (1 - y / (PLOT.height - PLOT.foot));
    return [this.low + x * (this.high - this.low), Math.min(this.top, Math.max(0, density))];
  }

  draw() {
    const { values, densities } = this.transfer;
    const places = values.map((value, i) => [this.x(value), this.y(densities[i])]);
    const line = [[0, places[0][1]], ...places, [PLOT.width, places.at(-1)[1]]].map((place) => place.map((one) => one.toFixed(2)).join(",")).join(" ");
    const words_ = [[this.low, 0, "start"], [this.high, PLOT.width, "end"]].map(([value, x, anchor]) =>
      shape("text", { x, y: PLOT.height - 3, "text-anchor": anchor }, short(value)));
    this.points = places.map((place, i) => this.point(place, i));
    this.svg.replaceChildren(this.bars(), shape("polyline", { points: line }), ...words_, ...this.points);
  }

  bars() {
    const { shares = [], low = 0, high = 1 } = this.histogram ?? {};
    const foot = PLOT.height - PLOT.foot, most = Math.max(...shares, 0), step = (high - low) / (shares.length || 1);
    const path = shares.map((share, i) => {
      const part = share > 0 ? Math.max(0, 1 + Math.log10(share / most) / DECADES) : 0;
      const [left, right] = [low + i * step, low + (i + 1) * step].map((value) => this.x(value).toFixed(2));
      return `M${left} ${foot}V${(foot * (1 - part)).toFixed(2)}H${right}V${foot}`;
    });
    return shape("path", { d: path.join(""), class: "elvis-bars" });
  }

  point([x, y], i) {
    const { values, densities } = this.transfer;
    const point = shape("circle", { cx: x.toFixed(2), cy: y.toFixed(2), r: 5.5, tabindex: 0, role: "slider", class: "elvis-grip",
      "aria-label": `point ${i + 1}`, "aria-valuenow": values[i], "aria-valuetext": `value ${short(values[i])}, density ${short(densities[i])}` });
    point.append(shape("title", {}, `value ${short(values[i])}, density ${short(densities[i])}`));
    point.addEventListener("pointerdown", (e) => {
      this.svg.setPointerCapture(e.pointerId);
      this.dragged = i;
    });
    point.addEventListener("keydown", (e) => this.key(e, i));
    return point;
  }

  // the function with a point moved between its neighbours
  moved(i, value, density) {
    const { values, densities } = this.transfer, least = 1e-6 * (this.high - this.low);
    const low = i > 0 ? values[i - 1] + least : -Infinity, high = i + 1 < values.length ? values[i + 1] - least : Infinity;
    const put = (list, own) => list.map((old, k) => (k === i ? own : old));
    const next = low <= high ? Math.min(high, Math.max(low, value)) : values[i];
    return { ...this.transfer, values: put(values, next), densities: put(densities, Math.max(0, density)) };
  }

  drag(event) {
    if (this.dragged === undefined) return;
    const [value, density] = this.under(event);
    this.transfer = this.moved(this.dragged, Math.min(this.high, Math.max(this.low, value)), density);
    this.isMoved = true;
    this.draw();
    this.pending ??= requestAnimationFrame(() => {
      this.pending = null;
      if (this.dragged !== undefined) this.set(this.transfer, true);
    });
  }

  release() {
    this.dragged = undefined;
    if (this.isMoved) this.set(this.transfer, false);
    this.isMoved = false;
  }

  key(event, i) {
    const { values, densities } = this.transfer, part = event.shiftKey ? 0.1 : 0.01;
    const [across, upwards] = [part * (this.high - this.low), 2 * part * this.top];
    const step = { ArrowLeft: [-across, 0], ArrowRight: [across, 0], ArrowDown: [0, -upwards], ArrowUp: [0, upwards] }[event.key];
    if (step) this.set(this.moved(i, values[i] + step[0], densities[i] + step[1]), false);
    else if (event.key === "Enter") this.insert(i + 1 < values.length ? (values[i] + values[i + 1]) / 2 : (values[i] + this.high) / 2);
    else if (event.key === "Delete" || event.key === "Backspace") this.remove(i);
    else return;
    event.preventDefault();
    event.stopPropagation();
  }

  // a double click removes the point under it, else adds one; pointers are captured, so the target of the event cannot tell which
  twice(event) {
    const under = this.points.indexOf(this.svg.getRootNode().elementFromPoint(event.clientX, event.clientY));
    if (under >= 0) {
      this.remove(under);
      return;
    }
    const [value, density] = this.under(event);
    this.insert(value, density);
  }

  // add a point; without a density, on the line
  insert(value, density) {
    const { values, densities, colors } = this.transfer;
    if (values.includes(value)) return;
    const after = values.findIndex((one) => one > value), at = after < 0 ? values.length : after;
    const [left, right] = [Math.max(0, at - 1), Math.min(values.length - 1, at)];
    const part = left === right ? 0 : (value - values[left]) / (values[right] - values[left]);
    const between = (one, other) => one + part * (other - one);
    const add = (list, own) => [...list.slice(0, at), own, ...list.slice(at)];
    const next = { ...this.transfer, values: add(values, value), densities: add(densities, density ?? between(densities[left], densities[right])) };
    if (colors?.length) next.colors = add(colors, colors[left].map((one, k) => between(one, colors[right][k])));
    this.set(next, false);
  }

  remove(i) {
    const { values, densities, colors } = this.transfer;
    if (values.length < 2) return;
    const take = (list) => list.filter((_, k) => k !== i);
    this.set({ ...this.transfer, values: take(values), densities: take(densities), ...(colors?.length ? { colors: take(colors) } : {}) }, false);
  }
}

// ---------------------------------------------------------------- ranges, dragged on colour bars

//: length of the linear part of a symmetric logarithmic scale relative to that of a power of ten, as in matplotlib
const LINEAR_ROOM = 1 / (1 - 0.1);

// function that maps values to positions along a bar, up to a linear map, and its inverse
function scaleOf({ scale, linear }) {
  if (scale === "log") return { there: Math.log, back: Math.exp };
  if (scale !== "symlog") return { there: (value) => value, back: (place) => place };
  const there = (value) => {
    const size = Math.abs(value) / linear;
    return Math.sign(value) * (size <= 1 ? LINEAR_ROOM * size : LINEAR_ROOM + Math.log10(size));
  };
  const back = (place) => {
    const size = Math.abs(place);
    return Math.sign(place) * linear * (size <= LINEAR_ROOM ? size / LINEAR_ROOM : 10 ** (size - LINEAR_ROOM));
  };
  return { there, back };
}

class BarGrips {
  constructor(viewer) {
    this.viewer = viewer;
    this.svg = shape("svg", { class: "elvis-handles" });
    this.svg.addEventListener("pointermove", (e) => this.drag(e));
    for (const kind of ["pointerup", "pointercancel"]) this.svg.addEventListener(kind, () => this.release());
    this.svg.addEventListener("dblclick", () => this.last && this.send(this.last, null, false));
  }

  draw() {
    const { picture, canvas } = this.viewer;
    const bars = (picture?.bars ?? []).filter((bar) => bar.high > bar.low && this.keys(bar).length);
    this.svg.setAttribute("viewBox", `0 0 ${canvas.width} ${canvas.height}`);
    Object.assign(this.svg.style, { width: canvas.style.width, height: canvas.style.height });
    const focused = this.svg.contains(document.activeElement) ? document.activeElement.getAttribute("aria-label") : null;
    // a bar that is being dragged preserves its values even if final pictures arrive
    const held = this.dragged?.bar;
    this.svg.replaceChildren(...bars.flatMap((bar) => this.grips(bar.title === held?.title ? Object.assign(held, { box: bar.box, upright: bar.upright }) : bar)));
    if (focused) [...this.svg.children].find((one) => one.getAttribute("aria-label") === focused)?.focus({ preventScroll: true });
  }

  // keys of a range in the scene: the scene's own, or those of the objects that show another quantity or have their own range
  keys({ title, low, high }) {
    const { table, picture } = this.viewer, field = picture.field;
    const shown = this.viewer.listed().filter(({ item }) => item.kind !== "volume" && item.kind !== "clip" && (item.style?.quantity ?? field) === title);
    const own = shown.filter(({ item }) => item.style?.range?.[0] === low && item.style?.range?.[1] === high);
    const rest = title === field ? ["range"] : shown.map(({ key }) => `${key}.style.range`);
    return own.length && !(table.range?.[0] === low && table.range?.[1] === high) ? own.map(({ key }) => `${key}.style.range`) : rest;
  }

  grips(bar) {
    const [left, top, width, height] = bar.box, ratio = this.viewer.density;
    return ["low", "high"].map((end) => {
      const value = this.dragged?.bar === bar ? this.dragged[end] : bar[end];
      const part = this.partOf(bar, value);
      const [x, y] = bar.upright ? [left + width / 2, top + (1 - part) * height] : [left + part * width, top + height / 2];
      const grip = shape("circle", { cx: x.toFixed(1), cy: y.toFixed(1), r: 7 * ratio, tabindex: 0, role: "slider", class: "elvis-grip elvis-bar-grip",
        "aria-label": `${end} end of the range of ${bar.title}`, "aria-valuenow": value, "aria-valuetext": short(value) });
      grip.dataset.name = end;
      grip.append(shape("title", {}, `${short(value)}. Drag or use arrow keys: change the ${end} end of the colour range; double-click or Delete: automatic range`));
      grip.addEventListener("pointerdown", (e) => this.press(e, bar, end));
      grip.addEventListener("keydown", (e) => this.key(e, bar, end));
      return grip;
    });
  }

  partOf(bar, value) {
    const { there } = scaleOf(bar), [low, high] = [there(bar.low), there(bar.high)];
    return (there(value) - low) / (high - low);
  }

  valueAt(bar, part) {
    if (part === 0) return bar.low;
    if (part === 1) return bar.high;
    const { there, back } = scaleOf(bar), [low, high] = [there(bar.low), there(bar.high)];
    return back(low + part * (high - low));
  }

  press(event, bar, end) {
    event.stopPropagation();
    this.svg.setPointerCapture(event.pointerId);
    this.last = bar;
    this.dragged = { bar, end, low: bar.low, high: bar.high, x: event.clientX, y: event.clientY, isMoved: false };
  }

  drag(event) {
    const own = this.dragged;
    if (!own) return;
    const ratio = this.viewer.density, { bar, end } = own;
    const step = bar.upright ? ((own.y - event.clientY) * ratio) / bar.box[3] : ((event.clientX - own.x) * ratio) / bar.box[2];
    Object.assign(own, this.put(bar, end, step), { isMoved: true });
    this.draw();
    this.pending ??= requestAnimationFrame(() => {
      this.pending = null;
      if (this.dragged) this.send(bar, [own.low, own.high], true);
    });
  }

  // both ends, one of them moved by a part of the bar; they stay at least a thousandth of it apart
  put(bar, end, step) {
    const part = end === "high" ? Math.max(0.001, 1 + step) : Math.min(0.999, step);
    return { low: bar.low, high: bar.high, [end]: this.valueAt(bar, part) };
  }

  release() {
    const own = this.dragged;
    this.dragged = null;
    if (own?.isMoved) this.send(own.bar, [own.low, own.high], false);
  }

  key(event, bar, end) {
    if (event.key === "Delete") return this.send(bar, null, false);
    const step = { ArrowDown: -0.01, ArrowLeft: -0.01, ArrowUp: 0.01, ArrowRight: 0.01 }[event.key];
    if (!step) return;
    const { low, high } = this.put(bar, end, step * (event.shiftKey ? 10 : 1));
    this.send(bar, [low, high], false);
    event.preventDefault();
    event.stopPropagation();
  }

  // keys that do not exist need not be removed
  send(bar, range, isMoving) {
    const keys = this.keys(bar).filter((key) => range || valueAt(this.viewer.table, key) !== undefined);
    if (keys.length) this.viewer.change(Object.fromEntries(keys.map((key) => [key, range])), isMoving);
  }
}

// ---------------------------------------------------------------- the last picture from a moved camera

//: colours of a sharp picture that move with the camera, at most
const MOST_MOVED = 1e6;

// 16-bit numbers from compressed bytes
async function unpacked(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint16Array(await new Response(stream).arrayBuffer());
}

// the same as base64
const numbersOf = (text) => unpacked(Uint8Array.from(atob(text), (one) => one.charCodeAt(0)));

// x' = A x + b maps points from the frame (right, up, forward) of one camera to that of another one; and world units of a pixel
// of pictures of a height, at distance one in perspective
function passage(first, camera, height) {
  const old = frameOf(first, height), now = frameOf(camera, height), offset = minus(first.eye, camera.eye);
  const rows = [now.right, now.up, now.forward].map((axis) => [dot(axis, old.right), dot(axis, old.up), dot(axis, old.forward), dot(axis, offset)]);
  return { rows, from: first.fov ? old.pixel / old.distance : old.pixel, to: camera.fov ? now.pixel / now.distance : now.pixel };
}

// whether two cameras show the same, but for a shift and a scale
function isShift(first, camera) {
  if (first.fov || camera.fov) return false;
  const old = frameOf(first, 1), now = frameOf(camera, 1);
  return Math.min(dot(old.right, now.right), dot(old.forward, now.forward)) > 1 - 1e-12;
}

// The last picture, sharp or a draft, moved with the camera by the depths of its pixels until the next one arrives; over it the
// lines of a draft, as sharp as the page allows.
class Warp {
  constructor(viewer) {
    // source: the last picture; camera: that of what is shown, null while that is the last picture itself
    Object.assign(this, { viewer, source: null, camera: null });
    const layer = () => make("canvas", { className: "elvis-warp", hidden: true, ariaHidden: "true" });
    this.canvas = layer();
    this.lines = layer();
    this.axes = new MovingAxes(viewer);
    this.layers = [this.canvas, this.lines, this.axes.canvas];
  }

  get paper() {
    const [red, green, blue] = this.viewer.background.map((part) => Math.round(255 * part));
    return ((255 << 24) | (blue << 16) | (green << 8) | red) >>> 0;
  }

  // a picture's colours in a number of pixels, and the camera from which it shows them
  take(picture, corner, [width, height], lines) {
    const { image, camera } = this.viewer.picture;
    const canvas = new OffscreenCanvas(width, height);
    canvas.getContext("2d", { willReadFrequently: true }).drawImage(picture, ...corner, 0, 0, width, height);
    this.source = { canvas, width, height, image: image.slice(2), camera: { up: [0, 0, 1], ...camera }, lines };
  }

  // take a whole picture; its depths follow
  async keep() {
    this.hide();
    this.source = null;
    const { viewer } = this, { picture } = viewer, { kind } = viewer.facts ?? {};
    if (!kind || kind === "line" || !picture.camera) return;
    this.takeWhole(viewer.canvas, picture.image, []);
    if (kind === "plane") return;
    const { source } = this, found = await viewer.ask("depths", null).catch(() => null);
    if (found?.number !== picture.number) return;
    const [parts, ...lines] = await Promise.all([found.data, ...(found.lines ? [found.numbers, found.colors, found.ends] : [])].map(numbersOf));
    if (source !== this.source) return;
    if (found.lines) this.lift(found, ...lines);
    Object.assign(this.source, { known: found, parts, cell: picture.image[2] / this.source.width / found.step });
  }

  // take a whole picture without its arrows along the axes, which don't move with the data
  takeWhole(canvas, corner, lines) {
    const { viewer } = this, { image: [, , width, height], arrows } = viewer.picture, part = Math.min(1, Math.sqrt(MOST_MOVED / (width * height)));
    this.take(canvas, corner, [Math.ceil(part * width), Math.ceil(part * height)], lines);
    const context = this.source.canvas.getContext("2d");
    context.fillStyle = viewer.paper;
    if (arrows) context.fillRect(...[arrows[0], arrows[1], arrows[2], arrows[2]].map((one) => one * part));
  }

  // take the lines of the domain off a whole picture: they are drawn where the camera sees them
  lift(found, numbers, colors, ends) {
    const { viewer } = this, [left, top, width, height] = viewer.picture.image, canvas = new OffscreenCanvas(width, height);
    const context = canvas.getContext("2d"), places = new Uint32Array(numbers.buffer);
    context.drawImage(viewer.canvas, left, top, width, height, 0, 0, width, height);
    const pixels = context.getImageData(0, 0, width, height);
    places.forEach((place, k) => pixels.data.set(colors.subarray(3 * k, 3 * k + 3), 4 * place));
    context.putImageData(pixels, 0, 0);
    this.takeWhole(canvas, [0, 0, width, height], this.linesOf(found, ends, 1, 1));
  }

  // take a draft, whose depths and lines are at hand, and show it from where the camera is now
  draft({ motion, camera }, picture, numbers) {
    const { width, height } = picture, { image } = this.viewer.picture;
    const [columns, rows] = motion.size, parts = numbers.slice(0, columns * rows);
    for (let at = 0; at < parts.length; at++) if (at % columns) parts[at] += parts[at - 1];
    this.take(picture, [0, 0, width, height], [width, height], this.linesOf(motion, numbers.subarray(parts.length), image[2] / width, image[3] / height));
    if (this.viewer.facts?.kind !== "plane") Object.assign(this.source, { known: motion, parts, cell: 1 / motion.step });
    this.canvas.hidden = true;
    this.show(this.viewer.camera ?? this.source.camera);
  }

  // lines of each style: column and row on the picture and depth of both ends
  linesOf({ lines, low, high, parts_of_pixel, margin }, numbers, scaleX, scaleY) {
    let begin = 0;
    return lines.map(({ count, ...style }) => {
      const ends = new Float64Array(6 * count), span = (high - low) / 65534;
      const read = [(one) => (one / parts_of_pixel - margin + 0.5) * scaleX, (one) => (one / parts_of_pixel - margin + 0.5) * scaleY, (one) => low + (one - 1) * span];
      for (let row = 0; row < 3; row++) {
        const first = begin + row * count, second = first + 3 * count;
        for (let k = 0; k < count; k++) {
          ends[6 * k + row] = read[row](numbers[first + k]);
          ends[6 * k + 3 + row] = read[row]((numbers[first + k] + numbers[second + k]) & 65535);
        }
      }
      begin += 6 * count;
      return { ...style, ends };
    });
  }

  hide() {
    for (const layer of this.layers) layer.hidden = true;
    this.camera = null;
  }

  // show the last picture from a camera
  show(camera) {
    const { source } = this;
    if (!source) return;
    const isSame = ["eye", "at", "up", "fov", "height"].every((key) => String(camera[key] ?? "") === String(source.camera[key] ?? ""));
    if (isSame) this.canvas.hidden = true;
    else if (isShift(source.camera, camera)) this.shift(camera);
    else if (source.parts) this.splat(camera);
    else return;
    this.camera = camera;
    this.stroke(camera);
    this.axes.draw(camera);
    this.place();
    this.viewer.handles.draw();
  }

  // parallel views in one direction differ by a shift and a scale
  shift(camera) {
    const { canvas, image: [width, height], camera: first } = this.source;
    const { rows: [x, y], from, to } = passage(first, camera, height), scale = from / to;
    Object.assign(this.canvas, { width, height });
    const context = this.canvas.getContext("2d");
    context.fillStyle = this.viewer.paper;
    context.fillRect(0, 0, width, height);
    context.setTransform(scale, 0, 0, scale, (width * (1 - scale)) / 2 + x[3] / to, (height * (1 - scale)) / 2 - y[3] / to);
    context.drawImage(canvas, 0, 0, width, height);
    this.canvas.hidden = false;
  }

  // each pixel moves to where the camera sees its point, the nearest one counts
  splat(camera) {
    const { width, height, image, camera: first } = this.source, { pixels, depths, behind } = this.points();
    const { rows: [a, b, c], from, to } = passage(first, camera, image[1]), scale = image[1] / height;
    const target = new ImageData(width, height), colors = new Uint32Array(target.data.buffer), nearest = new Float32Array(width * height).fill(Infinity);
    const empty = new Uint8Array(width * height);
    colors.fill(this.paper);
    const middleX = width / 2, middleY = height / 2, isPerspective = Boolean(first.fov), isSeenInPerspective = Boolean(camera.fov);
    for (let row = 0, at = 0; row < height; row++) {
      for (let column = 0; column < width; column++, at++) {
        const depth = depths[at];
        if (depth === Infinity) continue;
        const wide = from * scale * (isPerspective ? depth : 1), x = (column + 0.5 - middleX) * wide, y = (middleY - row - 0.5) * wide;
        const far = c[0] * x + c[1] * y + c[2] * depth + c[3], shrink = to * scale * (isSeenInPerspective ? far : 1);
        if (!(shrink > 0)) continue;
        const px = Math.floor(middleX + (a[0] * x + a[1] * y + a[2] * depth + a[3]) / shrink);
        const py = Math.floor(middleY - (b[0] * x + b[1] * y + b[2] * depth + b[3]) / shrink);
        if (px < 0 || py < 0 || px >= width || py >= height) continue;
        const to_ = py * width + px;
        if (depth === behind) empty[to_] = 1;
        else if (far < nearest[to_]) {
          nearest[to_] = far;
          colors[to_] = pixels[at];
        }
      }
    }
    this.close(colors, nearest, empty, width, height);
    this.mend(colors, nearest, width, height);
    Object.assign(this.canvas, { width, height });
    this.canvas.getContext("2d").putImageData(target, 0, 0);
    this.canvas.hidden = false;
  }

  // what nearer surfaces have hidden before continues the farther one of the pixels on both sides, unless the background has moved there
  close(colors, nearest, empty, width, height) {
    const most = Math.ceil(width / 8);
    for (let row = 0; row < height; row++) {
      const start = row * width, end = start + width;
      for (let at = start; at < end; at++) {
        if (nearest[at] !== Infinity) continue;
        const begin = at;
        while (at < end && nearest[at] === Infinity) at++;
        if (begin === start || at === end || at - begin > most) continue;
        const color = colors[nearest[begin - 1] > nearest[at] ? begin - 1 : at];
        for (let hole = begin; hole < at; hole++) if (!empty[hole]) colors[hole] = color;
      }
    }
  }

  // cracks in stretched surfaces, up to three pixels wide, through which one sees what is behind: with the surface on both sides
  mend(colors, nearest, width, height) {
    const { low, high } = this.source.known, gap = 0.01 * (high - low);
    for (let row = 2; row < height - 2; row++) {
      for (let at = row * width + 2, end = (row + 1) * width - 2; at < end; at++) {
        const limit = nearest[at] - gap;
        for (const step of [1, width]) {
          const isBefore = nearest[at - step] < limit, isAfter = nearest[at + step] < limit;
          if (!((isBefore || nearest[at - 2 * step] < limit) && (isAfter || nearest[at + 2 * step] < limit))) continue;
          colors[at] = colors[isBefore ? at - step : isAfter ? at + step : at - 2 * step];
          break;
        }
      }
    }
  }

  // colours and depths of the picture's pixels, once; pixels of volumes get a depth between the others, empty ones one behind all
  points() {
    const { source } = this, { width, height, canvas, parts, known: { size: [columns, rows], low, high }, cell } = source;
    if (source.depths) return source;
    const pixels = new Uint32Array(canvas.getContext("2d").getImageData(0, 0, width, height).data.buffer), { paper } = this;
    const depths = new Float32Array(width * height), span = (high - low) / 65534;
    const hasVolume = this.viewer.listed().some(({ item }) => item.kind === "volume");
    const usual = high > 0 ? (low + high) / 2 : length(minus(source.camera.at, source.camera.eye)), behind = high + 0.01 * (high - low) + 1e-9 * usual;
    for (let row = 0, at = 0; row < height; row++) {
      const j = Math.min(rows - 1, Math.floor(row * cell));
      for (let column = 0; column < width; column++, at++) {
        const i = Math.min(columns - 1, Math.floor(column * cell)), isPaper = pixels[at] === paper;
        let part = parts[j * columns + i];
        // depths are coarser than colours: at an edge the neighbours know better
        if (isPaper ? part : !part) {
          for (const [x, y] of [[i - 1, j], [i + 1, j], [i, j - 1], [i, j + 1]]) {
            if (x < 0 || y < 0 || x >= columns || y >= rows) continue;
            const other = parts[y * columns + x];
            if (isPaper ? !other : other) part = other;
          }
        }
        depths[at] = part ? low + (part - 1) * span : isPaper ? behind : hasVolume ? usual : Infinity;
      }
    }
    return Object.assign(source, { pixels, depths, behind: Math.fround(behind) });
  }

  // column and row of the stored depths where the picture shows a point, and its depth; null beside the picture
  cellOf(point) {
    const { source } = this, { image: [width, height], known: { size: [columns, rows] }, cell } = source;
    const { x, y } = seenAt(source.camera, point, source.image), column = Math.floor(((x * source.width) / width) * cell), row = Math.floor(((y * source.height) / height) * cell);
    if (!(column >= 0 && row >= 0 && column < columns && row < rows)) return null;
    return { at: row * columns + column, depth: dot(minus(point, source.camera.eye), frameOf(source.camera, 1).forward) };
  }

  // whether the picture shows something in front of a point, by more than its depths are coarse
  hides(point) {
    const { parts, known, image, camera } = this.source ?? {}, found = parts ? this.cellOf(point) : null;
    if (!found || !parts[found.at]) return false;
    const coarse = (6 * seenAt(camera, point, image).pixel * image[0]) / known.size[0];
    return known.low + ((parts[found.at] - 1) * (known.high - known.low)) / 65534 < found.depth - coarse;
  }

  // the point that the picture shows at a column and row of its stored depths, null where it shows nothing
  pointAt(column, row) {
    const { image: [width, height], camera, known: { size: [columns, rows], low, high }, parts, cell, width: wide, height: tall } = this.source;
    const part = column >= 0 && row >= 0 && column < columns && row < rows ? parts[row * columns + column] : 0;
    if (!part) return null;
    const { right, up, forward, pixel, distance } = frameOf(camera, height), depth = low + ((part - 1) * (high - low)) / 65534;
    const scale = camera.fov ? (pixel * depth) / distance : pixel;
    const x = (((column + 0.5) / cell) * width) / wide - width / 2, y = height / 2 - (((row + 0.5) / cell) * height) / tall;
    return plus(camera.eye, plus(plus(times(x * scale, right), times(y * scale, up)), times(depth, forward)));
  }

  // the point of the picture under a pointer, null where there is none or depths are not known
  under([x, y]) {
    if (!this.source?.parts) return null;
    const { image: [width, height], cell, width: wide, height: tall } = this.source;
    return this.pointAt(Math.floor(((x * wide) / width) * cell), Math.floor(((y * tall) / height) * cell));
  }

  // middle and diagonal of the box around the points of the picture that a camera sees, null if there are none
  seen(camera) {
    if (!this.source?.parts) return null;
    const { known: { size: [columns, rows] }, image } = this.source, step = Math.max(1, Math.floor(Math.min(columns, rows) / 64));
    const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
    for (let row = 0; row < rows; row += step) {
      for (let column = 0; column < columns; column += step) {
        const point = this.pointAt(column, row), place = point && seenAt(camera, point, image);
        if (!place || place.pixel <= 0 || place.x < 0 || place.y < 0 || place.x > image[0] || place.y > image[1]) continue;
        for (let i = 0; i < 3; i++) {
          low[i] = Math.min(low[i], point[i]);
          high[i] = Math.max(high[i], point[i]);
        }
      }
    }
    return low[0] <= high[0] ? { middle: times(0.5, plus(low, high)), size: length(minus(high, low)) } : null;
  }

  // the lines of a draft, which its pixels don't contain
  stroke(camera) {
    const { lines, image: [width, height], camera: first } = this.source;
    this.lines.hidden = !lines.length;
    if (!lines.length) return;
    const { rows: [a, b, c], from, to } = passage(first, camera, height);
    Object.assign(this.lines, { width, height });
    const context = this.lines.getContext("2d");
    context.lineCap = "round";
    for (const { ends, width: thick, color, opacity } of lines) {
      context.beginPath();
      for (let at = 0; at < ends.length; at += 3) {
        const depth = ends[at + 2], wide = from * (first.fov ? depth : 1), x = (ends[at] - width / 2) * wide, y = (height / 2 - ends[at + 1]) * wide;
        const shrink = to * (camera.fov ? c[0] * x + c[1] * y + c[2] * depth + c[3] : 1);
        const px = width / 2 + (a[0] * x + a[1] * y + a[2] * depth + a[3]) / shrink, py = height / 2 - (b[0] * x + b[1] * y + b[2] * depth + b[3]) / shrink;
        if (at % 6) context.lineTo(px, py);
        else context.moveTo(px, py);
      }
      context.lineWidth = thick;
      context.strokeStyle = `rgba(${color.map((part) => Math.round(255 * part))}, ${opacity})`;
      context.stroke();
    }
  }

  place() {
    const { picture, density } = this.viewer, [left, top, width, height] = picture.image.map((one) => one / density);
    const style = { left: `${left}px`, top: `${top}px`, width: `${width}px`, height: `${height}px` };
    for (const layer of [this.canvas, this.lines]) Object.assign(layer.style, style);
  }
}

//: colours of the arrows along x, y and z
const AXES = ["rgb(200, 40, 40)", "rgb(30, 140, 30)", "rgb(40, 70, 200)"];

// The box of the data and its axes while the camera moves: those of the last sharp picture are out of place.
class MovingAxes {
  constructor(viewer) {
    this.viewer = viewer;
    this.canvas = make("canvas", { className: "elvis-warp", hidden: true, ariaHidden: "true" });
  }

  draw(camera) {
    const { table, facts, picture, canvas: { width, height }, paper, background } = this.viewer;
    this.canvas.hidden = !(((table.axes || table.box) && facts?.box) || picture.arrows);
    if (this.canvas.hidden) return;
    const [left, top, ...size] = picture.image, context = this.canvas.getContext("2d"), isDark = 0.2126 * background[0] + 0.7152 * background[1] + 0.0722 * background[2] < 0.4;
    Object.assign(this.canvas, { width, height });
    Object.assign(this.canvas.style, { width: this.viewer.canvas.style.width, height: this.viewer.canvas.style.height });
    Object.assign(this, { context, size, camera, unit: Math.max(10, Math.round(Math.min(...size) / 45)) });
    context.fillStyle = paper;
    if (table.axes) this.clear([left, top, ...size], width, height);
    context.translate(left, top);
    context.fillStyle = context.strokeStyle = isDark ? "rgb(235, 235, 235)" : "rgb(30, 30, 30)";
    context.font = `${Math.round(1.15 * this.unit)}px sans-serif`;
    context.lineWidth = Math.max(1, 0.08 * this.unit);
    if (picture.arrows) this.arrows(picture.arrows);
    if (!facts?.box) return;
    const axes = [0, 1, 2].filter((axis) => facts.box[1][axis] > facts.box[0][axis]), edges = axes.flatMap((axis) => this.edges(axis, axes));
    if (table.box) for (const { ends } of edges) this.edge(ends);
    const sides = table.axes ? this.sides() : null;
    if (sides) context.strokeRect(0, 0, ...size);
    if (table.axes) for (const ruler of sides ?? this.rulers(edges)) this.rule(ruler);
  }

  // the ticks of the last sharp picture lie to the left and below; bars stay
  clear([left, top, width, height], right, bottom) {
    const { bars } = this.viewer.picture, below = Math.min(bottom, ...bars.map(({ box }) => box[1]).filter((one) => one > top + height));
    this.context.fillRect(0, top, left, below - top);
    this.context.fillRect(0, top + height, left + width, below - top - height);
  }

  // arrows along the axes in their square; those that point away are first
  arrows([left, top, side]) {
    const { context, unit } = this, { right, up, forward } = frameOf(this.camera, 1), middle = [left + side / 2, top + side / 2];
    context.save();
    Object.assign(context, { textAlign: "center", textBaseline: "middle" });
    for (const axis of [0, 1, 2].sort((one, other) => forward[other] - forward[one])) {
      const along = times(2.4 * unit, [right[axis], -up[axis]]), far = length(along), tip = plus(middle, along), head = times((0.55 * unit) / (far || 1), along), across = times(0.4, [-head[1], head[0]]);
      Object.assign(context, { fillStyle: AXES[axis], strokeStyle: AXES[axis], lineWidth: Math.max(1, unit / 6) });
      this.polyline(middle, tip);
      context.stroke();
      if (far < unit / 3) continue;
      this.polyline(plus(tip, times(0.4, head)), plus(minus(tip, head), across), minus(minus(tip, head), across));
      context.fill();
      context.fillText("xyz"[axis], ...plus(middle, times(1.32, along)));
    }
    context.restore();
  }

  polyline(...points) {
    this.context.beginPath();
    for (const point of points) this.context.lineTo(...point);
  }

  seen(point) {
    return seenAt(this.camera, point, this.size);
  }

  // the edges of the box along an axis; a flat box has fewer
  edges(axis, axes) {
    const [low, high] = this.viewer.facts.box, others = axes.filter((other) => other !== axis);
    return Array.from({ length: 2 ** others.length }, (_, chosen) => {
      const start = low.map((value, i) => (others.includes(i) && (chosen >> others.indexOf(i)) & 1 ? high[i] : value));
      return { axis, ends: [start, start.map((value, i) => (i === axis ? high[i] : value))] };
    });
  }

  // an edge of the box, where nothing is in front of it
  edge([start, end]) {
    const { context } = this, count = 100;
    let isDown = false;
    context.beginPath();
    for (let k = 0; k <= count; k++) {
      const point = plus(start, times(k / count, minus(end, start))), { x, y } = this.seen(point), isFree = !this.viewer.warp.hides(point);
      if (isFree && isDown) context.lineTo(x, y);
      else context.moveTo(x, y);
      isDown = isFree;
    }
    context.save();
    context.clip(this.window());
    context.stroke();
    context.restore();
  }

  window() {
    const window = new Path2D();
    window.rect(0, 0, ...this.size);
    return window;
  }

  // rulers below and to the left of a parallel view along an axis; null for others
  sides() {
    const { right, up, pixel } = frameOf(this.camera, this.size[1]), [width, height] = this.size;
    const along = [right, up].map((way) => way.findIndex((part) => Math.abs(part) > 1 - 1e-12));
    if (this.camera.fov || along.includes(-1)) return null;
    return [0, 1].map((k) => {
      const axis = along[k], sign = [right, up][k][axis], half = (this.size[k] / 2) * pixel, middle = this.camera.eye[axis];
      const place = (value) => (k ? { x: 0, y: height / 2 - ((value - middle) * sign) / pixel } : { x: width / 2 + ((value - middle) * sign) / pixel, y: height });
      return { axis, line: k ? [{ x: 0, y: height }, { x: 0, y: 0 }] : [{ x: 0, y: height }, { x: width, y: height }], away: k ? [-1, 0] : [0, 1],
        marks: roundValues(middle - half, middle + half).map((value) => ({ value, ...place(value) })) };
    });
  }

  // a ruler for each axis along an edge of the box that is a silhouette: the lowest one, or the leftmost
  rulers(edges) {
    const box = this.viewer.facts.box, middle = times(0.5, plus(...box)), centre = this.seen(middle), best = {};
    for (const { axis, ends } of edges) {
      const line = ends.map((point) => this.seen(point)), [dx, dy] = [line[1].x - line[0].x, line[1].y - line[0].y];
      if (!(Math.hypot(dx, dy) >= 20) || !this.isSilhouette(axis, ends, middle)) continue;
      const rank = Math.abs(dx) > Math.abs(dy) ? line[0].y + line[1].y : -line[0].x - line[1].x;
      if (rank > (best[axis]?.rank ?? -Infinity)) best[axis] = { rank, axis, ends, line };
    }
    return Object.values(best).map(({ axis, ends, line }) => {
      const [dx, dy] = [line[1].x - line[0].x, line[1].y - line[0].y], size = Math.hypot(dx, dy);
      const outwards = (dy * (line[0].x + line[1].x - 2 * centre.x) - dx * (line[0].y + line[1].y - 2 * centre.y)) / size;
      const away = times(outwards > 0 ? 1 / size : -1 / size, [dy, -dx]);
      const marks = roundValues(ends[0][axis], ends[1][axis]).map((value) => ({ value, ...this.seen(ends[0].map((own, i) => (i === axis ? value : own))) }));
      return { axis, line, away, marks };
    });
  }

  // whether one of the two sides of the box at an edge faces the eye and the other does not
  isSilhouette(axis, ends, middle) {
    const [low, high] = this.viewer.facts.box, towards = this.camera.fov ? minus(times(0.5, plus(...ends)), this.camera.eye) : minus(this.camera.at, this.camera.eye);
    const faced = [0, 1, 2].filter((other) => other !== axis).map((other) => towards[other] * (ends[0][other] - middle[other]) < 0);
    return faced[0] !== faced[1] || low.some((value, i) => value === high[i]);
  }

  rule({ axis, line, away, marks }) {
    const { context, unit } = this, [x, y] = away;
    context.textAlign = Math.abs(x) < 0.5 ? "center" : x < 0 ? "right" : "left";
    context.textBaseline = Math.abs(y) < 0.5 ? "middle" : y > 0 ? "top" : "bottom";
    context.beginPath();
    context.moveTo(line[0].x, line[0].y);
    context.lineTo(line[1].x, line[1].y);
    // as many marks as their texts leave room for
    const wide = Math.max(0, ...marks.map(({ value }) => context.measureText(short(value)).width)), need = Math.abs(x) * 1.4 * unit + Math.abs(y) * (wide + unit);
    const apart = marks.length > 1 ? Math.hypot(marks[1].x - marks[0].x, marks[1].y - marks[0].y) : need, every = Math.ceil(need / apart);
    let extent = 0;
    for (const mark of marks.filter((_, k) => k % every === 0)) {
      const text = short(mark.value);
      context.moveTo(mark.x, mark.y);
      context.lineTo(mark.x + 0.35 * unit * x, mark.y + 0.35 * unit * y);
      context.fillText(text, mark.x + 0.6 * unit * x, mark.y + 0.6 * unit * y);
      extent = Math.max(extent, Math.abs(x) * context.measureText(text).width + Math.abs(y) * 1.15 * unit);
    }
    context.stroke();
    const far = 1.1 * unit + extent;
    context.fillText("xyz"[axis], (line[0].x + line[1].x) / 2 + far * x, (line[0].y + line[1].y) / 2 + far * y);
  }
}

// ---------------------------------------------------------------- another picture behind a divider, or next to the first

//: available refinements
const REFINEMENTS = [0, 1, 2, 3, 4];

// The picture of linear elements, or of a second dataset, from the same camera; requested when a picture has arrived.
class Beside {
  constructor(viewer) {
    // shown: {type, content, note}, null for nothing; isApart: side by side
    Object.assign(this, { viewer, shown: null, isApart: false, split: 0.5, asked: 0, before: null });
    this.canvas = make("canvas", { className: "elvis-linear", ariaLabel: "the other picture" });
    this.note = make("span", { className: "elvis-caption" });
    this.own = make("span", { className: "elvis-caption" });
    this.divider = make("div", { className: "elvis-divider", tabIndex: 0, title: "Drag or use arrow keys: move the border between the two pictures" });
    for (const [name, value] of Object.entries({ role: "separator", "aria-orientation": "vertical", "aria-label": "divider", "aria-valuemin": 0, "aria-valuemax": 100 })) {
      this.divider.setAttribute(name, value);
    }
    this.parts = [this.canvas, this.note, this.own, this.divider];
    this.divider.addEventListener("pointerdown", (e) => this.divider.setPointerCapture(e.pointerId));
    this.divider.addEventListener("pointermove", (e) => this.divider.hasPointerCapture(e.pointerId) && this.move(this.under(e)));
    this.divider.addEventListener("keydown", (e) => this.key(e));
    this.choice = make("select", { "aria-label": "linear elements", title: "Compare with the picture of linear elements", onchange: (e) => this.chooseLinear(e.target.selectedIndex) },
      make("option", {}, "linear: off"), ...REFINEMENTS.map((n) => make("option", {}, `linear: ${n} refinement${n === 1 ? "" : "s"}`)));
    this.second = make("select", { "aria-label": "second dataset", title: "Compare with a second dataset; files can also be dropped on the picture", onchange: (e) => this.chooseOther(e.target.value) });
    this.files = make("input", { type: "file", multiple: true, hidden: true, ariaLabel: "files of a second dataset", onchange: () => this.read([...this.files.files]) });
    this.clear();
  }

  // ---- choices

  chooseLinear(index) {
    this.chosen = this.second.value = "";
    this.restore();
    const n = REFINEMENTS[index - 1];
    this.choose(index ? { type: "linear", content: { level: n } } : null, false);
  }

  chooseOther(text) {
    this.choice.selectedIndex = 0;
    const [how, name] = text.split(": ");
    this.chosen = how === "files…" ? "" : text;
    if (how === "files…") this.files.click();
    if (how === "difference") this.subtract(name);
    else this.restore();
    this.choose(how === "divider" || how === "side by side" ? { type: "other", content: { name } } : null, how === "side by side");
  }

  choose(shown, isApart) {
    Object.assign(this, { shown, isApart });
    this.clear();
    this.viewer.sized();
    if (this.viewer.isWhole) this.ask();
  }

  // the difference of the field, in colours about zero; what was shown before comes back with another choice
  async subtract(name) {
    this.restore();
    const { viewer } = this, field = viewer.shown();
    this.before = Object.fromEntries(["field", "palette", "range"].map((key) => [key, viewer.table[key] ?? null]));
    this.field = `${field} - ${name}:${field}`;
    const wanted = this.field;
    viewer.change({ field: wanted, palette: "coolwarm", range: "visible" });
    // a range symmetric about zero, once the values are known
    do await viewer.rest(); while (this.before && viewer.picture.field !== wanted);
    if (!this.before || viewer.table.field !== wanted) return;
    const most = Math.max(...(viewer.picture.ranges[wanted] ?? []).map(Math.abs));
    if (most > 0 && Number.isFinite(most)) viewer.change({ range: [-most, most] });
  }

  restore() {
    const { before, viewer } = this;
    this.before = null;
    if (!before || viewer.table.field !== this.field) return;
    viewer.change(Object.fromEntries(Object.entries(before).filter(([key, value]) => value !== null || viewer.table[key] !== undefined)));
  }

  // the datasets that can be compared
  update() {
    const { facts, model } = this.viewer, others = facts?.others ?? [];
    const options = [...others.flatMap((name) => ["difference", "divider", "side by side"].map((how) => `${how}: ${name}`)), ...(model.upload ? ["files…"] : [])];
    const text = options.join();
    if (text === this.options) return;
    this.options = text;
    this.second.replaceChildren(make("option", { value: "" }, "compare: off"), ...options.map((one) => make("option", {}, one)));
    this.second.value = this.chosen = options.includes(this.chosen) ? this.chosen : "";
    this.second.hidden = !options.length;
  }

  // files that were chosen or dropped
  async read(files) {
    const { viewer } = this;
    if (!files.length || !viewer.model.upload) return;
    viewer.waitFor("reading the second dataset");
    viewer.recover("reading");
    try {
      await viewer.model.upload(files, viewer);
      this.name = files.map((file) => file.name).join(", ");
      this.chooseOther("divider: other");
      this.second.value = this.chosen;
    } catch (error) {
      viewer.fail({ text: error.message, until: "reading" });
    }
    this.files.value = "";
  }

  // ---- the picture

  clear() {
    this.asked += 1;
    for (const part of this.parts) part.hidden = true;
  }

  // the last picture is a draft: a second dataset is drawn as well, one draft at a time
  async draft() {
    if (this.shown?.type !== "other") return this.clear();
    if (this.isDrafting) return;
    this.isDrafting = true;
    const found = await this.request(true).catch(() => null);
    this.isDrafting = false;
    if (found && !this.viewer.isWhole) await this.take(found);
  }

  request(draft) {
    const { type, content } = this.shown;
    return this.viewer.ask(type, type === "other" ? { ...content, draft } : content);
  }

  async ask() {
    const isKept = this.shown?.type === "other" && !this.canvas.hidden;
    if (isKept) this.asked += 1;
    else this.clear();
    if (!this.shown) return;
    const { asked, viewer } = this;
    try {
      const found = await this.request(false);
      if (found && asked === this.asked) await this.take(found);
    } catch (error) {
      if (asked !== this.asked) return;
      this.choice.selectedIndex = 0;
      this.chosen = this.second.value = "";
      this.choose(null, false);
      viewer.fail({ text: error.message });
    }
  }

  async take(found) {
    const bytes = Uint8Array.from(atob(found.file), (one) => one.charCodeAt(0));
    const picture = await createImageBitmap(new Blob([bytes]));
    if (!this.shown) return;
    Object.assign(this.canvas, { width: picture.width, height: picture.height });
    this.canvas.getContext("2d").drawImage(picture, 0, 0);
    const { name } = this.shown.content;
    this.note.textContent = this.shown.type === "linear" ? `${found.simplices.toLocaleString("en")} linear simplices` : (name === "other" && this.name) || name;
    this.own.textContent = (this.viewer.facts.files ?? []).join(", ");
    for (const part of this.parts) part.hidden = false;
    this.divider.hidden = this.isApart;
    this.own.hidden = this.shown.type === "linear";
    this.place();
  }

  // over the image, to the right of the divider; or in the other half of the page
  place() {
    if (this.canvas.hidden) return;
    const ratio = this.viewer.density;
    const [left, top, width, height] = this.viewer.picture.image.map((one) => one / ratio);
    const at = this.isApart ? 0 : this.split * width, away = this.isApart ? this.viewer.stage.clientWidth / 2 : 0;
    Object.assign(this.canvas.style, { left: `${left + away}px`, top: `${top}px`, width: `${width}px`, height: `${height}px`, clipPath: `inset(0 0 0 ${at}px)` });
    Object.assign(this.divider.style, { left: `${left + at}px`, top: `${top}px`, height: `${height}px` });
    Object.assign(this.note.style, { left: `${left + away + at + 8}px`, top: `${top + 6}px` });
    Object.assign(this.own.style, { left: `${left + 8}px`, top: `${top + 6}px`, maxWidth: `${(at || width) - 16}px` });
    this.divider.setAttribute("aria-valuenow", Math.round(100 * this.split));
  }

  // ---- the divider

  under(event) {
    const [column] = this.viewer.place(event);
    return column / this.viewer.picture.image[2];
  }

  move(split) {
    this.split = Math.min(1, Math.max(0, split));
    this.place();
  }

  key(event) {
    const step = { ArrowLeft: -0.02, ArrowRight: 0.02 }[event.key];
    if (!step) return;
    this.move(this.split + step);
    event.preventDefault();
    event.stopPropagation();
  }
}

// ---------------------------------------------------------------- the steps of a series

//: available steps per second
const SPEEDS = [1, 2, 5, 10, 25];

// A slider over the steps; playing shows one step after another, each once the one before has arrived.
class TimeBar {
  constructor(viewer) {
    Object.assign(this, { viewer, timer: 0, isPlaying: false });
    const button = (text, title, act) => make("button", { type: "button", title, ariaLabel: text === "▶" ? "play" : text, ariaPressed: "false", onclick: act }, text);
    this.play = button("▶", "Play or stop", () => (this.isPlaying ? this.stop() : this.begin()));
    this.loop = button("loop", "Repeat from the start", () => this.toggle(this.loop));
    this.fixed = button("one range", "Use one certified colour range for all steps, or the range of each step", () => this.fix());
    this.values = button("over time", "Click in the picture: plot exact values over time", () => viewer.setMode(viewer.mode === "time" ? "turn" : "time"));
    this.slider = make("input", { type: "range", min: 0, step: 1, "aria-label": "step",
      oninput: () => this.go(Number(this.slider.value), true), onchange: () => this.go(Number(this.slider.value), false) });
    this.time = make("input", { type: "number", step: "any", "aria-label": "time", title: "Time to show; coefficients are interpolated between steps",
      onchange: () => this.time.value !== "" && this.show({ time: Number(this.time.value), step: null }, false) });
    this.speed = make("select", { "aria-label": "steps per second" }, ...SPEEDS.map((one) => make("option", { value: one }, `${one} / s`)));
    this.speed.selectedIndex = 2;
    this.note = make("span", { className: "elvis-aside" });
    this.root = make("div", { className: "elvis-time", hidden: true }, this.play, this.loop, this.speed, this.slider, this.time, this.note, this.fixed, this.values);
  }

  get times() {
    return this.viewer.facts?.times ?? [];
  }

  // the current step, or the one nearest to the current time
  get step() {
    const { step, time } = this.viewer.table, { length: count } = this.times;
    if (step !== undefined) return step < 0 ? step + count : step;
    if (time === undefined) return count - 1;
    const away = this.times.map((one) => Math.abs(one - time));
    return away.indexOf(Math.min(...away));
  }

  // the current step, or the two steps around the current time
  get place() {
    const { time } = this.viewer.table, last = this.times.length - 1;
    const above = time === undefined ? -1 : this.times.findIndex((one) => one > time);
    if (above < 1 || this.times.includes(time)) return `step ${this.step} of 0 to ${last}`;
    return `between ${above - 1} and ${above} of 0 to ${last}`;
  }

  update() {
    this.root.hidden = this.times.length < 2;
    if (this.root.hidden) return this.stop();
    this.slider.max = this.times.length - 1;
    const isHeld = this.slider.matches(":active");
    if (!isHeld) this.slider.value = this.step;
    if (!this.time.isTyped) this.time.value = Number((this.viewer.table.time ?? this.times[this.step]).toPrecision(10));
    this.note.textContent = this.place;
    this.fixed.ariaPressed = String(Array.isArray(this.viewer.table.range));
  }

  toggle(button) {
    button.ariaPressed = String(button.ariaPressed !== "true");
  }

  show(changes, moving) {
    // keys that do not exist cannot be removed
    const own = Object.entries(changes).filter(([key, value]) => value !== null || this.viewer.table[key] !== undefined);
    this.viewer.change(Object.fromEntries(own), moving);
    // the server does not report moving values back to the page that moves them
    const kept = Object.entries({ ...this.viewer.table, ...changes }).filter(([, value]) => value !== null);
    this.viewer.table = Object.fromEntries(kept);
    this.update();
  }

  go(step, moving) {
    this.show({ step, time: null }, moving);
  }

  begin() {
    this.isPlaying = true;
    Object.assign(this.play, { textContent: "■", ariaLabel: "stop" });
    this.advance(this.step >= this.times.length - 1 ? 0 : this.step);
  }

  // the next step, once this one is on the page
  advance(step) {
    if (!this.isPlaying) return;
    const [last, start] = [this.times.length - 1, performance.now()];
    const shown = this.viewer.frames ?? 0;
    this.go(step, true);
    const wait = () => {
      const isDue = performance.now() - start >= 1000 / Number(this.speed.value);
      if (!this.isPlaying) return;
      if (!isDue || (this.viewer.frames ?? 0) === shown) this.timer = setTimeout(wait, 15);
      else if (step < last) this.advance(step + 1);
      else if (this.loop.ariaPressed === "true") this.advance(0);
      else this.stop();
    };
    this.timer = setTimeout(wait, 15);
  }

  stop() {
    if (!this.isPlaying) return;
    this.isPlaying = false;
    clearTimeout(this.timer);
    Object.assign(this.play, { textContent: "▶", ariaLabel: "play" });
    this.go(this.step, false);
  }

  async fix() {
    if (this.fixed.ariaPressed === "true") return this.viewer.change({ range: "visible" });
    try {
      this.viewer.change({ range: await this.viewer.ask("series range", this.viewer.picture.field) });
    } catch (error) {
      this.viewer.fail({ text: error.message });
    }
  }
}

// ---------------------------------------------------------------- the viewer

const VIEWS = { "+x": "+x", "−x": "-x", "+y": "+y", "−y": "-y", "+z": "+z", "−z": "-z", iso: "iso" };
//: directions of named views towards the eye, and upward directions
const SENSES = { "+x": "from the left, z upwards", "-x": "from the right, z upwards", "+y": "from the front, z upwards",
  "-y": "from the back, z upwards", "+z": "from below, y upwards", "-z": "from above, y upwards", iso: "from the corner with maximum x, y and z" };
//: objects with a surface that can be added, and the surface's name in the schema
const SURFACES = { plane: "Plane", sphere: "Sphere", cylinder: "Cylinder", cone: "Cone", clip: "Plane" };
const COLOUR = ["field", "palette", "range", "bar"];
const LIGHT = ["lights", "ambient", "background", "samples"];
const FIGURE = ["title", "axes", "scale_bar", "box", "outline", "domain_outline", "texts", "image", "font_size"];
const STEP = Math.PI / 24;
//: `wheelDelta` of one notch of a mouse's wheel; pixels of one, in browsers that do not report it; pixels of a tenth on macOS
const NOTCH = 120, LEAST_WHEEL = 50, MAC_NOTCH = 4.000244140625;
//: diagonals of the picture above which that of the box around what is visible is deep
const DEEP = 2;
//: background of pictures on dark pages
const DARK = [0.086, 0.098, 0.114];
//: pixels by which a key moves the cross, or a grip of a handle
const NUDGE = 8;
//: colour of bodies next to other objects
const GREY = [0.78, 0.78, 0.78];
//: radii of a new tube in the diagonal of what is visible
const TUBES = 350;
//: colour of lines and glyphs on 2D data
const INK = [0.08, 0.08, 0.08];
//: sizes of a page and its image (column, row, width and height) before either is known
const FIRST = { size: [720, 670], image: [13, 39, 600, 600] };
//: pixels by which a page may be smaller than its area
const SLACK = 20;

// whether a small picture has an aspect ratio other than an image's, apart from rounding to pixels
// seconds of drawing after which the reason is shown
const MANY_SECONDS = 3;

// whether an object is a surface, on which lines can lie
const isSurface = ({ kind }) => ["cut", "faces", "isosurface"].includes(kind);
// the outer boundary in one colour, behind other objects
const WALLS = { kind: "faces", style: { color: [0.7, 0.7, 0.7] } };
const isWalls = (object) => object.kind === "faces" && !object.names && JSON.stringify(object.style?.color) === JSON.stringify(WALLS.style.color);

// what the buttons of the toolbar switch: whether a scene has it, and the changes that switch it
class Toggles {
  constructor(viewer) {
    this.viewer = viewer;
    const style = (key, value) => ({ isOn: () => this.surfaces.length > 0 && this.surfaces.every((object) => object.style?.[key]), change: (on) => this.styled({ [key]: on ? value : undefined }) });
    this.all = {
      mesh: { title: "Borders of elements on surfaces", ...style("mesh_lines", {}) },
      contours: { title: "Contour lines on surfaces", ...style("contours", TEN_LINES) },
      LIC: { title: "Streaks along the velocity on surfaces", ...style("lic", {}) },
      light: { title: "Shade surfaces with the lights", isOn: () => this.surfaces.every((object) => object.style?.lit !== false), change: (on) => this.styled({ lit: on ? undefined : false }) },
      log: { title: "Colours by the logarithm", isOn: () => this.table.bar?.scale === "log", change: (on) => ({ bar: on ? { ...this.table.bar, scale: "log" } : this.linearBar }) },
      axes: { title: "Axes with ticks", isOn: () => Boolean(this.table.axes), change: (on) => ({ axes: on }) },
      walls: { title: "Outer boundary in grey", is3D: true, isOn: () => (this.table.objects ?? []).some(isWalls), change: (on) => this.walled(on) },
    };
    this.buttons = Object.entries(this.all).map(([name, { title }]) => make("button", { type: "button", title, onclick: () => this.toggle(name) }, name));
    this.root = make("span", { role: "group", ariaLabel: "show", className: "elvis-toggles" }, ...this.buttons);
  }

  get table() {
    return this.viewer.table;
  }

  // all objects, the plane among them; without any, all outer faces
  get objects() {
    const { plane, objects = [] } = this.table;
    const every = plane ? [{ kind: "cut", surface: { kind: "plane", ...plane } }, ...objects] : objects;
    return every.length ? every : [{ kind: "faces" }];
  }

  get surfaces() {
    return this.objects.filter((object) => isSurface(object) && !isWalls(object));
  }

  get linearBar() {
    const { scale, ...rest } = this.table.bar ?? {};
    return Object.keys(rest).length ? rest : null;
  }

  // changes that give every surface other values of its style; undefined takes one away
  styled(values) {
    const objects = this.objects.map((object) => {
      if (!isSurface(object) || isWalls(object)) return object;
      const style = { ...object.style, ...values };
      for (const key of Object.keys(values)) if (values[key] === undefined) delete style[key];
      return { ...object, style };
    });
    return this.listed(objects);
  }

  walled(on) {
    const rest = this.objects.filter((object) => !isWalls(object));
    return this.listed(on ? [...rest, WALLS] : rest);
  }

  // changes that replace all objects; the plane becomes one of them
  listed(objects) {
    return this.table.plane ? { plane: null, objects } : { objects };
  }

  toggle(name) {
    const { isOn, change } = this.all[name];
    this.viewer.change(change(!isOn()));
  }

  update() {
    const isPlane = this.viewer.facts?.kind === "plane";
    Object.values(this.all).forEach(({ isOn, is3D }, i) => {
      this.buttons[i].ariaPressed = String(isOn());
      this.buttons[i].hidden = Boolean(is3D && isPlane);
    });
  }
}

// ---------------------------------------------------------------- plots below the picture

//: colours of curves, distinct in light and dark pages
const CURVES = ["#2a78b8", "#d9591a", "#2f9e5b", "#9b59b6", "#a8790b", "#159a9a"];
//: their dashes, so that curves are seen that lie on each other
const DASHES = ["", "8 4", "2 4", "9 3 2 3"];
//: values of a curve up to which each has a dot
const FEW = 60;
//: what a plot shows: its title, the columns that its x axis can show, and what asks for values
const PLOTS = {
  line: { title: "along lines", columns: ["distance", "x", "y", "z"],
    read: async (viewer, { start, end }, quantity) => {
      const { points, values, elements } = await viewer.ask("line", { start, end, quantities: [quantity] });
      const [x, y, z] = [0, 1, 2].map((axis) => points.map((point) => point[axis]));
      return { columns: { distance: points.map((point) => length(minus(point, points[0]))), x, y, z, element: elements }, values: values[0] };
    } },
  section: { title: "along walls", columns: ["x/c", "length", "x", "y", "z"],
    read: async (viewer, source, quantity) => {
      const { wall, axis, columns } = await viewer.ask("section", { place: source.place, axis: source.axis ?? null, quantities: [quantity] });
      Object.assign(source, { axis, wall, name: axis ? `${wall}, ${axis} = ${short(source.place["xyz".indexOf(axis)])}` : wall });
      const { [quantity]: values, ...rest } = columns;
      return { columns: rest, values };
    } },
  time: { title: "over time", columns: ["time"],
    read: async (viewer, { place }, quantity) => {
      const { times, values } = await viewer.ask("history", { quantity, place });
      const [x, y, z] = [0, 1, 2].map((axis) => times.map(() => place[axis] ?? 0));
      return { columns: { time: times, x, y, z }, values };
    } },
  histogram: { title: "histogram by volume", columns: ["value"],
    read: async (viewer, _, quantity) => {
      const { low, high, shares } = await viewer.ask("histogram", quantity);
      const edges = Array.from({ length: shares.length + 1 }, (_one, i) => low + ((high - low) * i) / shares.length);
      return { columns: { value: edges.slice(0, -1), "value up to": edges.slice(1) }, values: shares };
    } },
};
//: names of the pressure coefficient; the predefined one needs p_ref and u_ref
const COEFFICIENT = /^(c_?p|pressure_coefficient)$/i;
//: sizes in a plot: margins, height of the axis below, of a legend's line
const FRAME = { left: 74, right: 14, top: 12, bottom: 38, legend: 16, least: 120 };

// A plot that stays: curves of several sources, one frame for each quantity, with common x axis.
class Plot {
  constructor(plots, kind, quantity) {
    Object.assign(this, { plots, viewer: plots.viewer, kind, sources: [], quantities: [quantity], x: PLOTS[kind].columns[0] });
    this.body = make("div", { className: "elvis-plot-body" });
    this.head = make("div", { className: "elvis-plot-head" });
    this.readout = make("output", { className: "elvis-aside", ariaLabel: "values at the cursor" });
    this.root = make("section", { className: "elvis-plot", ariaLabel: `plot ${PLOTS[kind].title}` }, this.head, this.body, this.readout);
    new ResizeObserver(() => this.draw()).observe(this.body);
  }

  // a source's color is the first one that no other has
  async add(source) {
    const taken = this.sources.map((one) => one.color);
    const color = CURVES.find((one) => !taken.includes(one)) ?? CURVES[this.sources.length % CURVES.length];
    const own = { color, dash: DASHES[CURVES.indexOf(color) % DASHES.length], curves: new Map(), ...source };
    await this.read(own);
    this.sources.push(own);
    this.draw();
  }

  async read(source, quantities = this.quantities) {
    this.readout.textContent = "computing…";
    try {
      for (const quantity of quantities) source.curves.set(quantity, await PLOTS[this.kind].read(this.viewer, source, quantity));
    } finally {
      this.readout.textContent = "";
    }
  }

  // values at another moment
  async refresh() {
    for (const source of this.sources) await this.read(source);
    this.draw();
  }

  async addQuantity(quantity) {
    if (this.quantities.includes(quantity)) return;
    try {
      for (const source of this.sources) await this.read(source, [quantity]);
      this.quantities.push(quantity);
    } catch (error) {
      this.viewer.fail({ text: error.message });
    }
    this.draw();
  }

  remove(source) {
    this.sources = this.sources.filter((one) => one !== source);
    if (this.sources.length) this.draw();
    else this.plots.close(this);
  }

  // ---- controls

  heading() {
    const button = (text, title, act) => make("button", { type: "button", title, ariaLabel: title, onclick: act }, text);
    const names = Object.entries(this.viewer.facts.quantities ?? {});
    const more = make("select", { ariaLabel: "add a quantity to the plot", onchange: (e) => e.target.selectedIndex && this.addQuantity(e.target.value) }, make("option", {}, "quantity…"),
      ...names.map(([label, own]) => make("optgroup", { label }, ...own.map((name) => make("option", {}, name)))));
    const { columns } = PLOTS[this.kind];
    const across = make("select", { ariaLabel: "x axis", onchange: (e) => { this.x = columns[e.target.selectedIndex]; this.draw(); } }, ...columns.map((name) => make("option", { selected: name === this.x }, name)));
    return [make("h3", {}, PLOTS[this.kind].title), more, ...(columns.length > 1 ? [across] : []), ...this.normals(),
      this.saving(), button("×", "Close the plot", () => this.plots.close(this))];
  }

  saving() {
    const types = ["csv", "svg", "png"];
    const choose = (e) => {
      const type = types[e.target.selectedIndex - 1];
      e.target.selectedIndex = 0;
      this.save(type);
    };
    return make("select", { ariaLabel: "save the plot", onchange: choose }, make("option", {}, "save…"), ...types.map((type) => make("option", {}, type.toUpperCase())));
  }

  // the direction at right angles to the last section
  normals() {
    const last = this.sources.at(-1);
    if (this.kind !== "section" || !last?.axis) return [];
    const choose = async (axis) => {
      const old = last.axis;
      last.axis = axis;
      try {
        await this.read(last);
      } catch (error) {
        last.axis = old;
        this.viewer.fail({ text: error.message });
      }
      this.draw();
    };
    return [make("select", { ariaLabel: "normal of the section", title: "Direction at right angles to the last section", onchange: (e) => choose("xyz"[e.target.selectedIndex]) },
      ...["x", "y", "z"].map((axis) => make("option", { selected: axis === last.axis }, `normal ${axis}`)))];
  }

  chips() {
    const source = (one) => {
      const mark = shape("svg", { width: 22, height: 4, "aria-hidden": "true" });
      mark.append(shape("path", { d: "M0 2h22", stroke: one.color, "stroke-width": 3, "stroke-dasharray": one.dash }));
      return make("span", { className: "elvis-chip" }, mark, one.name, make("button", { type: "button", className: "elvis-mini", ariaLabel: `remove ${one.name}`, title: "Remove the curve", onclick: () => this.remove(one) }, "×"));
    };
    const quantity = (name) => make("span", { className: "elvis-chip" }, name, make("button", { type: "button", className: "elvis-mini", ariaLabel: `remove ${name}`, title: "Remove the quantity", onclick: () => { this.quantities = this.quantities.filter((other) => other !== name); this.draw(); } }, "×"));
    return make("div", { className: "elvis-chips" }, ...this.sources.map(source), ...(this.quantities.length > 1 ? this.quantities.map(quantity) : []));
  }

  // ---- drawing

  draw() {
    if (!this.sources.length) return;
    this.viewer.refill(this.head, [...this.heading(), this.chips()]);
    const width = Math.max(300, this.body.clientWidth - 2), height = Math.max(this.body.clientHeight - 4, FRAME.least * this.quantities.length);
    this.svg = this.picture(width, height, false);
    this.svg.addEventListener("pointermove", (e) => this.point(e.clientX));
    this.svg.addEventListener("pointerleave", () => this.point(null));
    this.svg.addEventListener("keydown", (e) => this.key(e));
    this.body.replaceChildren(this.svg);
    this.viewer.handles.draw();
  }

  // the plot as SVG; a saved one has a legend
  picture(width, height, isSaved) {
    const svg = shape("svg", { viewBox: `0 0 ${width} ${height}`, width, height, role: "img", tabindex: 0, "font-family": "system-ui, DejaVu Sans, sans-serif", "aria-label": this.described() });
    const top = isSaved ? FRAME.legend * this.sources.length + 4 : 0;
    if (isSaved) svg.append(...this.sources.flatMap((one, i) => this.legend(one, 14 + FRAME.legend * i)));
    const share = (height - top) / this.quantities.length;
    this.frames = this.quantities.map((quantity, i) => new PlotFrame(this, quantity, [FRAME.left, top + i * share + FRAME.top, width - FRAME.left - FRAME.right, share - FRAME.top - FRAME.bottom]));
    svg.append(...this.frames.flatMap((frame) => frame.shapes()));
    return svg;
  }

  legend({ color, dash, name }, y) {
    return [shape("path", { d: `M${FRAME.left} ${y - 4}h24`, stroke: color, "stroke-width": 2, "stroke-dasharray": dash }), shape("text", { x: FRAME.left + 30, y, "font-size": 12, fill: "currentColor" }, name)];
  }

  described() {
    return `${this.quantities.join(", ")} over ${this.x}: ${this.sources.map((one) => one.name).join("; ")}`;
  }

  // ---- values at the cursor

  point(clientX) {
    const first = this.sources[0]?.curves.get(this.quantities[0]);
    if (clientX === null || !first) return this.show(null);
    const box = this.svg.getBoundingClientRect(), frame = this.frames[0];
    const value = frame.valueAt(((clientX - box.left) * this.svg.viewBox.baseVal.width) / box.width);
    const along = first.columns[this.x];
    this.show(along.reduce((best, one, i) => (Math.abs(one - value) < Math.abs(along[best] - value) ? i : best), 0));
  }

  key(event) {
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    const first = this.sources[0]?.curves.get(this.quantities[0]);
    if (!step || !first) return;
    event.preventDefault();
    const count = first.values.length;
    this.show(Math.min(count - 1, Math.max(0, (this.cursor ?? Math.floor(count / 2)) + step * (event.shiftKey ? 10 : 1))));
  }

  // the values of the first curve at a point, which is marked in the picture
  show(index) {
    this.cursor = index;
    const own = this.sources[0], place = index === null ? null : own.curves.get(this.quantities[0]).columns;
    this.viewer.plots.cursor = place?.z ? ["x", "y", "z"].map((axis) => place[axis][index]) : null;
    for (const frame of this.frames) frame.point(index);
    const values = index === null ? [] : this.quantities.map((quantity) => `${quantity} = ${own.curves.get(quantity).values[index] ?? "not a number"}`);
    this.readout.textContent = index === null ? "" : [`${this.x} = ${short(place[this.x][index])}`, ...values].join("   ");
    this.viewer.handles.draw();
  }

  // ---- files

  csv() {
    const quote = (text) => `"${text.replaceAll('"', '""')}"`;
    const names = Object.keys(this.sources[0].curves.get(this.quantities[0]).columns).filter((name) => !["point", "status"].includes(name));
    const rows = this.sources.flatMap((source) => {
      const { columns, values } = source.curves.get(this.quantities[0]);
      return values.map((_, i) => [quote(source.name), ...names.map((name) => columns[name]?.[i] ?? ""), ...this.quantities.map((quantity) => source.curves.get(quantity).values[i] ?? "NaN")].join(","));
    });
    return [["source", ...names, ...this.quantities.map(quote)].join(","), ...rows, ""].join("\n");
  }

  async save(type) {
    const name = `${this.viewer.facts.name ?? "elvis"}-${this.kind}.${type}`;
    const give = (blob) => make("a", { href: URL.createObjectURL(blob), download: name }).click();
    if (type === "csv") return give(new Blob([this.csv()], { type: "text/csv" }));
    const [width, height] = [720, 40 + 260 * this.quantities.length], svg = this.picture(width, height, true);
    svg.setAttribute("color", "#1b1f24");
    svg.prepend(shape("rect", { width, height, fill: "#ffffff" }));
    const file = new Blob([new XMLSerializer().serializeToString(svg)], { type: "image/svg+xml" });
    this.draw();
    if (type === "svg") return give(file);
    const image = new Image(), canvas = make("canvas", { width: 2 * width, height: 2 * height });
    image.src = URL.createObjectURL(file);
    await image.decode();
    canvas.getContext("2d").drawImage(image, 0, 0, 2 * width, 2 * height);
    canvas.toBlob(give);
  }
}

// One quantity of a plot: axes with names, a curve for each source.
class PlotFrame {
  constructor(plot, quantity, [left, top, width, height]) {
    Object.assign(this, { plot, quantity, left, top, width, height });
    this.curves = plot.sources.map((source) => ({ source, ...source.curves.get(quantity) })).filter((one) => one.values);
    const isHistogram = plot.kind === "histogram";
    this.along = ({ columns }) => columns[plot.x];
    const across = this.curves.flatMap((one) => (isHistogram ? [one.columns.value[0], one.columns["value up to"].at(-1)] : this.along(one)));
    const values = this.curves.flatMap((one) => one.values.filter((value) => value !== null));
    this.ends = [extent(across), isHistogram ? [0, extent(values)[1]] : widened(extent(values))];
    // pressure coefficients are drawn with suction upwards
    this.isReversed = COEFFICIENT.test(quantity) && plot.kind === "section";
  }

  x(value) {
    const [low, high] = this.ends[0];
    return this.left + (this.width * (value - low)) / (high - low || 1);
  }

  y(value) {
    const [low, high] = this.ends[1], part = (value - low) / (high - low || 1);
    return this.top + this.height * (this.isReversed ? part : 1 - part);
  }

  valueAt(x) {
    const [low, high] = this.ends[0];
    return low + ((x - this.left) * (high - low)) / this.width;
  }

  shapes() {
    const foot = this.top + this.height, text = { "font-size": 12, fill: "currentColor" };
    const { plot } = this, [below, beside] = this.ends.map(([low, high]) => roundValues(low, high));
    const rules = [...below.map((value) => `M${this.x(value)} ${this.top}V${foot}`), ...beside.map((value) => `M${this.left} ${this.y(value)}h${this.width}`)];
    const middle = this.top + this.height / 2;
    const name = plot.kind === "histogram" ? "share of volume" : `${this.quantity}${this.isReversed ? " (reversed)" : ""}`;
    this.cursor = shape("path", { stroke: "currentColor", fill: "none", "stroke-dasharray": "3 3" });
    return [shape("path", { d: rules.join(""), stroke: "currentColor", opacity: 0.13, fill: "none" }),
      shape("path", { d: `M${this.left} ${this.top}V${foot}h${this.width}`, stroke: "currentColor", fill: "none" }),
      ...this.curves.flatMap((one) => this.curve(one)), ...this.outside(),
      ...beside.map((value) => shape("text", { ...text, x: this.left - 6, y: this.y(value) + 4, "text-anchor": "end" }, short(value))),
      ...below.map((value) => shape("text", { ...text, x: this.x(value), y: foot + 15, "text-anchor": "middle" }, short(value))),
      shape("text", { ...text, x: this.left + this.width / 2, y: foot + 31, "text-anchor": "middle" }, plot.kind === "histogram" ? this.quantity : plot.x),
      shape("text", { ...text, "text-anchor": "middle", transform: `translate(14 ${middle}) rotate(-90)` }, name), this.cursor];
  }

  // how much of the lines has no values
  outside() {
    const values = this.curves.flatMap((one) => one.values), count = values.filter((value) => value === null).length;
    if (this.plot.kind !== "line" || !count) return [];
    return [shape("text", { "font-size": 11, fill: "currentColor", x: this.left + this.width, y: this.top + 11, "text-anchor": "end" }, `${Math.ceil((100 * count) / values.length)} % outside the data`)];
  }

  curve(one) {
    const { color, dash } = one.source, isHistogram = this.plot.kind === "histogram";
    const line = shape("path", { d: isHistogram ? this.steps(one) : this.path(one), fill: "none", stroke: color, "stroke-width": 1.8, "stroke-linejoin": "round", "stroke-dasharray": dash });
    if (isHistogram) return [line];
    const along = this.along(one), known = (i) => (one.values[i] ?? null) !== null, isSparse = one.values.length <= FEW;
    // a value without neighbours makes no line
    return [line, ...one.values.map((value, i) => known(i) && (isSparse || !(known(i - 1) || known(i + 1))) && shape("circle", { cx: this.x(along[i]), cy: this.y(value), r: 2.5, fill: color })).filter(Boolean)];
  }

  // a curve, interrupted where there are no values and between several curves of a wall
  path(one) {
    const along = this.along(one), parts = one.columns.curve ?? [];
    let isDown = false;
    return one.values.map((value, i) => {
      if (value === null || along[i] === null) {
        isDown = false;
        return "";
      }
      const pen = isDown && parts[i] === parts[i - 1] ? "L" : "M";
      isDown = true;
      return `${pen}${this.x(along[i]).toFixed(2)} ${this.y(value).toFixed(2)}`;
    }).join("");
  }

  steps({ columns, values }) {
    const foot = this.y(0).toFixed(2);
    return values.map((share, i) => `M${this.x(columns.value[i]).toFixed(2)} ${foot}V${this.y(share).toFixed(2)}H${this.x(columns["value up to"][i]).toFixed(2)}V${foot}`).join("");
  }

  point(index) {
    const first = this.curves[0];
    const x = index === null || !first ? null : this.x(this.along(first)[index]);
    this.cursor.setAttribute("d", x === null ? "" : `M${x} ${this.top}v${this.height}`);
  }
}

const extent = (values) => values.reduce(([low, high], value) => [Math.min(low, value), Math.max(high, value)], [Infinity, -Infinity]);

// an interval with room above and below
function widened([low, high]) {
  const room = 0.04 * (high - low) || 0.04 * Math.abs(high) || 1;
  return [low - room, high + room];
}

// The plots below the picture, at most one of each kind; they follow the time that is shown.
class Plots {
  constructor(viewer) {
    Object.assign(this, { viewer, all: [], height: 270, cursor: null });
    this.row = make("div", { className: "elvis-plot-row" });
    this.sash = make("div", { className: "elvis-sash", tabIndex: 0, title: "Drag or use arrow keys: height of the plots" });
    for (const [name, value] of Object.entries({ role: "separator", "aria-orientation": "horizontal", "aria-label": "height of the plots", "aria-valuemin": 140, "aria-valuemax": 700 })) this.sash.setAttribute(name, value);
    this.sash.addEventListener("pointerdown", (e) => this.sash.setPointerCapture(e.pointerId));
    this.sash.addEventListener("pointermove", (e) => this.sash.hasPointerCapture(e.pointerId) && this.resize(this.root.getBoundingClientRect().bottom - e.clientY));
    this.sash.addEventListener("keydown", (e) => this.key(e));
    this.root = make("section", { className: "elvis-plots", ariaLabel: "plots", hidden: true }, this.sash, this.row);
  }

  key(event) {
    const step = { ArrowUp: 20, ArrowDown: -20 }[event.key];
    if (!step) return;
    event.preventDefault();
    event.stopPropagation();
    this.resize(this.height + step);
  }

  resize(height) {
    // the picture keeps more than half of the page
    this.height = Math.round(Math.max(140, Math.min(700, 0.45 * this.viewer.root.clientHeight, height)));
    this.root.style.height = `${this.height}px`;
    this.sash.setAttribute("aria-valuenow", this.height);
  }

  // add a curve to the plot of its kind, or to a new one
  async add(kind, source) {
    const existing = this.all.find((plot) => plot.kind === kind);
    const plot = existing ?? new Plot(this, kind, this.initial(kind));
    try {
      if (!existing) {
        this.all.push(plot);
        this.row.append(plot.root);
        this.root.hidden = false;
        this.resize(this.height);
      }
      await plot.add(source);
    } catch (error) {
      if (!plot.sources.length) this.close(plot);
      this.viewer.fail({ text: error.message });
    }
  }

  // the field of the picture; on walls the pressure coefficient, if the data have it
  initial(kind) {
    const names = Object.values(this.viewer.facts.quantities ?? {}).flat();
    const coefficient = kind === "section" ? names.find((name) => COEFFICIENT.test(name)) : null;
    return coefficient ?? this.viewer.picture.field;
  }

  close(plot) {
    this.all = this.all.filter((one) => one !== plot);
    plot.root.remove();
    this.root.hidden = !this.all.length;
    this.cursor = null;
    this.viewer.handles.draw();
  }

  // values of the picture's time, where it is another one than before
  follow() {
    const { step, time, phase, deform } = this.viewer.table, moment = JSON.stringify([step, time, phase, deform?.scale]);
    if (this.moment !== undefined && this.moment !== moment) {
      for (const plot of this.all) if (plot.kind !== "time") plot.refresh().catch((error) => this.viewer.fail({ text: error.message }));
    }
    this.moment = moment;
  }

  // points, lines and sections of the plots, for the picture: [colour, points]
  marks() {
    const found = this.all.flatMap((plot) => plot.sources.map((source) => [source.color, this.pointsOf(plot, source)]));
    return found.filter(([, points]) => points.length);
  }

  pointsOf(plot, source) {
    if (plot.kind === "time") return [source.place];
    const columns = plot.kind === "histogram" ? {} : source.curves.get(plot.quantities[0])?.columns ?? {};
    return (columns.x ?? []).map((x, i) => [x, columns.y[i], columns.z[i]]);
  }
}

// ---------------------------------------------------------------- the tree of data, and the objects in their order

const SHAPES = { tetrahedron: "tetrahedra", hexahedron: "hexahedra" };
const EYE = "M1 8s2.6-4.6 7-4.6S15 8 15 8s-2.6 4.6-7 4.6S1 8 1 8z";

// an eye, open or crossed out
function eyeIcon(isOpen) {
  const icon = shape("svg", { viewBox: "0 0 16 16", width: 16, height: 16, class: "elvis-icon", "aria-hidden": "true" });
  icon.append(shape("path", { d: EYE }), shape("circle", { cx: 8, cy: 8, r: 2.1 }), ...(isOpen ? [] : [shape("path", { d: "M2.5 14 13.5 2" })]));
  return icon;
}

//: colour and width in pixels of boundaries of 2D data
const LINE = [0.82, 0.28, 0.1], LINE_WIDTH = 3;

const hexOf = (color) => `#${color.slice(0, 3).map((part) => Math.round(255 * part).toString(16).padStart(2, "0")).join("")}`;
const colorOf = (hex) => [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16) / 255);

// Boundaries and regions as parts of the objects `faces`: which objects show a part, and the objects that show it otherwise.
// Boundaries of 2D data are lines on the domain, each an object of its own; regions are its elements.
class ShownParts {
  constructor(viewer) {
    this.viewer = viewer;
  }

  get objects() {
    return this.viewer.toggles.objects;
  }

  get boundaries() {
    return this.viewer.facts.boundaries;
  }

  get regions() {
    return Object.keys(this.viewer.facts.contents?.regions ?? {}).map((name) => `region:${name}`);
  }

  get areLines() {
    return this.viewer.facts.kind === "plane";
  }

  // whether a part is a line on the domain
  isLine(name) {
    return this.areLines && !name.startsWith("region:");
  }

  // whether an object shows faces, or elements of 2D data, all of which are also a cut
  hasFaces(object) {
    return object.kind === "faces" || (this.areLines && object.kind === "cut");
  }

  // whether an object shows a part, by its name in `select`
  shows(object, name) {
    return this.isLine(name) ? object.along === `boundary:${name}` : this.hasFaces(object) && this.names(object).includes(name);
  }

  owner(name) {
    return this.objects.find((object) => this.shows(object, name));
  }

  // names of the parts that faces show, "all" by the names of the boundaries, in 2D data of the regions
  names({ select = ["all"] }) {
    const every = this.areLines ? this.regions : this.boundaries;
    return select.flatMap((name) => (name === "all" && every.length ? every : [name]));
  }

  without(name) {
    if (this.isLine(name)) return this.objects.filter((object) => !this.shows(object, name));
    const objects = this.objects.map((object) => {
      if (!this.shows(object, name)) return object;
      const { surface: _, ...rest } = object;
      return { ...rest, kind: "faces", select: this.names(object).filter((one) => one !== name) };
    });
    return objects.filter((object) => object.kind !== "faces" || (object.select ?? ["all"]).length);
  }

  // objects that also show a part, in a style
  with(objects, name, style) {
    if (this.isLine(name)) return [...objects, { kind: "streamlines", along: `boundary:${name}`, width: LINE_WIDTH, style: style ?? { color: LINE } }];
    const text = JSON.stringify(style ?? {});
    const at = objects.findIndex((object) => object.kind === "faces" && JSON.stringify(object.style ?? {}) === text);
    if (at < 0) return [...objects, { kind: "faces", select: [name], ...(Object.keys(style ?? {}).length ? { style } : {}) }];
    return objects.map((object, i) => (i === at ? { ...object, select: this.joined([...(object.select ?? ["all"]), name]) } : object));
  }

  // names of parts; all elements of 2D data are "all"
  joined(names) {
    return this.areLines && this.regions.every((one) => names.includes(one)) ? ["all"] : names;
  }

  // a picture without any object would show everything, and lines alone have no field
  isLast(name) {
    const rest = this.without(name);
    return !rest.length || (this.areLines && !this.isLine(name) && !rest.some((object) => this.hasFaces(object)));
  }

  toggle(name) {
    this.take(this.owner(name) ? this.without(name) : this.with(this.given, name));
  }

  // null colours by the field
  paint(name, color) {
    const { color: _, ...rest } = this.owner(name)?.style ?? {};
    this.take(this.with(this.owner(name) ? this.without(name) : this.given, name, color ? { ...rest, color } : rest));
  }

  // without objects, all faces are shown; what is added then stands for itself, but for lines
  get given() {
    const { plane, objects = [] } = this.viewer.table;
    return this.areLines || plane || objects.length ? this.objects : [];
  }

  take(objects) {
    this.viewer.change({ ...this.viewer.toggles.listed(objects), ...this.viewer.still() });
  }
}

class DataTree {
  constructor(viewer) {
    this.viewer = viewer;
    this.parts = new ShownParts(viewer);
    this.root = make("nav", { className: "elvis-tree", ariaLabel: "data and objects", tabIndex: -1 });
  }

  update() {
    const { facts, schema } = this.viewer;
    if (!facts || !schema || this.dragged) return;
    this.viewer.refill(this.root, [...this.data(), ...this.objects()]);
    // the focus follows an object that was moved
    if (this.moved !== undefined) this.list.children[this.moved]?.querySelector(".elvis-mover")?.focus();
    this.moved = undefined;
  }

  // ---- the data

  data() {
    const { files = [], contents, kind } = this.viewer.facts;
    const rows = [make("h2", {}, "Data"), ...files.map((name) => make("div", { className: "elvis-leaf", title: name }, name))];
    if (!contents) return rows;
    const canHide = kind === "solid", isPlane = kind === "plane";
    rows.push(this.elements(contents), this.orders(contents), ...this.time(contents));
    rows.push(this.branch("boundaries", contents.boundaries, (name) => name, canHide || isPlane), this.branch("regions", contents.regions, (name) => `region:${name}`, canHide || isPlane));
    return [...rows.filter(Boolean), ...this.remarks()];
  }

  elements({ elements, dimension, space, curved }) {
    const many = (shape_, count) => (count === 1 ? shape_ : SHAPES[shape_] ?? `${shape_}s`);
    const total = Object.values(elements).reduce((sum, count) => sum + count, 0);
    const lines = Object.entries(elements).map(([name, count]) => `${count.toLocaleString("en")} ${many(name, count)}`);
    if (curved.some(Boolean)) lines.push(`curved: ${curved[0].toLocaleString("en")} edges, ${curved[1].toLocaleString("en")} faces`);
    return this.fold("elements", `${total.toLocaleString("en")}, ${dimension}D${space > dimension ? ` in ${space}D` : ""}`, lines, false);
  }

  orders({ orders }) {
    const names = Object.keys(orders), own = names.length > 1 ? `${names[0]} to ${names.at(-1)}` : names[0];
    const lines = Object.entries(orders).map(([order, count]) => `order ${order}: ${count.toLocaleString("en")} elements`);
    return names.length ? this.fold("orders", own, lines, false) : null;
  }

  time({ time }) {
    const { timeBar, table } = this.viewer;
    if (timeBar.times.length > 1) {
      const now = table.time ?? timeBar.times[timeBar.step];
      return [this.line("time", `${short(now)}, ${timeBar.place}`)];
    }
    return time === null || time === undefined ? [] : [this.line("time", short(time))];
  }

  line(name, text) {
    return make("div", { className: "elvis-leaf" }, make("span", { className: "elvis-key" }, name), ` ${text}`);
  }

  fold(name, note, lines, open) {
    const items = lines.map((one) => (typeof one === "string" ? make("li", {}, one) : one));
    const details = make("details", { open }, make("summary", {}, make("span", { className: "elvis-key" }, name), make("span", { className: "elvis-aside" }, `: ${note}`)), make("ul", {}, ...items));
    details.addEventListener("toggle", () => Controls.open.set(foldsAround(details).join("/"), details.open));
    return details;
  }

  branch(title, counts, selectOf, canHide) {
    const rows = Object.entries(counts).map(([name, count]) => this.part(name, count, selectOf(name), canHide));
    return rows.length ? this.fold(title, rows.length, rows, true) : null;
  }

  // a boundary or a region: its eye, its name and number of sides or elements, its colour
  part(name, count, select, canHide) {
    const note = make("span", { className: "elvis-aside" }, count.toLocaleString("en"));
    if (!canHide) return make("li", { className: "elvis-part" }, make("span", { className: "elvis-name" }, name), note);
    const owner = this.parts.owner(select), isLast = Boolean(owner) && this.parts.isLast(select);
    const eye = this.eye(Boolean(owner), name, isLast ? "The only visible part: add an object before you hide it" : "", () => this.parts.toggle(select));
    eye.disabled = isLast;
    return make("li", { className: "elvis-part" }, eye, make("span", { className: "elvis-name", title: name }, name), note, ...this.swatch(name, select, owner));
  }

  swatch(name, select, owner) {
    const color = owner?.style?.color;
    const field = make("input", { type: "color", value: hexOf(color ?? GREY), ariaLabel: `colour of ${name}`, title: color ? "One colour" : "Coloured by the field: choose one colour",
      className: color ? "" : "elvis-by-field", onchange: (e) => this.parts.paint(select, colorOf(e.target.value)) });
    const back = make("button", { type: "button", className: "elvis-mini", title: `Colour ${name} by the field`, ariaLabel: `colour ${name} by the field`, onclick: () => this.parts.paint(select, null) }, "↺");
    return color ? [back, field] : [field];
  }

  eye(isOpen, name, reason, act) {
    const own = make("button", { type: "button", className: "elvis-mini elvis-eye", title: reason || `${isOpen ? "Hide" : "Show"} ${name}`, ariaLabel: `${isOpen ? "hide" : "show"} ${name}`, onclick: act }, eyeIcon(isOpen));
    own.ariaPressed = String(isOpen);
    return own;
  }

  remarks() {
    const lines = this.viewer.facts.remarks ?? [];
    return lines.length ? [this.fold("remarks", lines.length, lines, false)] : [];
  }

  // ---- objects

  objects() {
    const { viewer } = this, listed = viewer.listed();
    const movable = listed.filter(({ item }) => item.kind !== "clip").length;
    const shown = listed.map((row, place) => this.object(row, place, movable));
    const hidden = viewer.hidden.map((one, number) => this.hiddenObject(one, number));
    const note = listed.length ? [] : [make("div", { className: "elvis-aside" }, viewer.facts.kind === "solid" ? "All outer faces are shown." : "The whole domain is shown.")];
    this.list = make("ul", { className: "elvis-objects" }, ...shown, ...hidden);
    return [make("h2", {}, "Objects"), ...note, this.list, viewer.adding()];
  }

  object({ key, item }, place, movable) {
    const { viewer } = this, name = `${place + 1} ${item.kind}`;
    const act = () => {
      viewer.selected = null;
      viewer.model.send({ type: "hide", key });
    };
    const grip = item.kind === "clip" || movable < 2 ? make("span", { className: "elvis-mini" }) : this.grip(name, place, movable);
    const open = make("button", { type: "button", className: "elvis-name", title: "Show the settings of the object", onclick: () => viewer.openObject(place) },
      name, make("span", { className: "elvis-aside" }, ` ${viewer.summary(item)}`));
    return make("li", { className: "elvis-part" }, grip, this.eye(true, name, "Hide the object; it stays in the list", act), open);
  }

  hiddenObject({ key, item }, number) {
    const { viewer } = this;
    const shown = key === "plane" ? { kind: "cut", surface: { kind: "plane", ...item } } : { kind: "clip", ...item };
    const name = `${shown.kind} ${viewer.summary(shown)}`.trim();
    const eye = this.eye(false, name, "Show the object again", () => viewer.model.send({ type: "unhide", number }));
    const gone = make("button", { type: "button", className: "elvis-mini", title: "Remove the object", ariaLabel: `delete ${name}`, onclick: () => viewer.model.send({ type: "forget", number }) }, "×");
    return make("li", { className: "elvis-part elvis-hidden" }, make("span", { className: "elvis-mini" }), eye, make("span", { className: "elvis-name" }, name), gone);
  }

  // ---- order

  grip(name, place, count) {
    const own = make("button", { type: "button", className: "elvis-mini elvis-mover", title: "Drag, or use the up and down arrow keys: change the order", ariaLabel: `move ${name}` }, "⠿");
    own.addEventListener("pointerdown", (e) => {
      own.setPointerCapture(e.pointerId);
      this.dragged = { place, to: place };
      e.preventDefault();
      own.focus({ preventScroll: true });
    });
    own.addEventListener("pointermove", (e) => this.dragged && this.drag(e, count));
    for (const kind of ["pointerup", "pointercancel"]) own.addEventListener(kind, () => this.drop());
    own.addEventListener("keydown", (e) => {
      const to = place + ({ ArrowUp: -1, ArrowDown: 1 }[e.key] ?? 0);
      if (to === place || to < 0 || to >= count) return;
      e.preventDefault();
      this.order(place, to);
    });
    return own;
  }

  // the row under the pointer is where the object goes
  drag(event, count) {
    const rows = [...this.list.children].slice(0, count), { dragged } = this;
    const passed = rows.filter((row, i) => i !== dragged.place && event.clientY > row.getBoundingClientRect().top + row.offsetHeight / 2);
    dragged.to = passed.length;
    rows.forEach((row, i) => {
      row.classList.toggle("elvis-lifted", i === dragged.place);
      row.classList.toggle("elvis-before", i === dragged.to && dragged.to < dragged.place);
      row.classList.toggle("elvis-after", i === dragged.to && dragged.to > dragged.place);
    });
  }

  drop() {
    const { place, to } = this.dragged ?? {};
    this.dragged = null;
    if (place === to) this.update();
    else this.order(place, to);
  }

  order(from, to) {
    const objects = [...this.viewer.toggles.objects];
    objects.splice(to, 0, ...objects.splice(from, 1));
    this.viewer.selected = null;
    this.moved = to;
    this.viewer.change({ ...this.viewer.toggles.listed(objects), ...this.viewer.still() });
  }
}

function isOtherShape([width, height], image) {
  return Math.abs(Math.log((width * image[3]) / (height * image[2]))) > 1 / Math.min(width, height) + 0.01;
}

// position of the image of a draft, which is as large as fits within a page
function imageWithin(own, page) {
  const part = Math.min(...page) / Math.min(...FIRST.size);
  const [left, top] = FIRST.image.map((one) => Math.round(one * part));
  const free = page.map((side, i) => side - part * (FIRST.size[i] - FIRST.image[2 + i]));
  const scale = Math.min(free[0] / own[0], free[1] / own[1]);
  return [left, top, ...own.map((side) => Math.round(side * scale))];
}

// Whether two fingers on a trackpad caused an event of the wheel.  A mouse's wheel turns by notches, which browsers report as
// lines, as multiples of 120 in `wheelDelta`, or on macOS as multiples of a tenth of a notch in pixels (as MapLibre tells them);
// fingers move by any number of pixels, also sideways.
function isOfTrackpad({ deltaMode, deltaX, deltaY, wheelDeltaX, wheelDeltaY }) {
  if (deltaMode !== WheelEvent.DOM_DELTA_PIXEL) return false;
  if (deltaX && deltaY) return true;
  if ((deltaX || deltaY) % MAC_NOTCH === 0) return false;
  const notches = wheelDeltaX || wheelDeltaY;
  return notches ? notches % NOTCH !== 0 : Math.abs(deltaX || deltaY) < LEAST_WHEEL;
}

class Viewer {
  constructor(model, el) {
    Object.assign(this, { model, table: {}, facts: null, picture: null, hidden: [], histograms: new Map(), waiting: new Map(), resting: [], mode: "turn", line: [], fingers: new Map() });
    this.build(el);
    model.on((message, buffer) => this.receive(message, buffer));
    model.open();
  }

  build(el) {
    this.isDark = window.matchMedia("(prefers-color-scheme: dark)");
    this.isDark.addEventListener("change", () => this.darken());
    this.canvas = make("canvas", { width: 16, height: 16, role: "img", "aria-label": "the picture" });
    this.error = make("div", { className: "elvis-error", hidden: true, role: "alert", title: "Click to dismiss", onclick: () => { this.error.hidden = true; } });
    const known = ([color, text]) => make("li", {}, make("span", { className: `elvis-mark elvis-${color}` }), text);
    this.proofLegend = make("ul", { className: "elvis-proof", hidden: true, ariaLabel: "legend of proof" }, ...[["grey", "certain: proved"], ["magenta", "ambiguous within the tolerance"], ["red", "failed"]].map(known));
    this.cross = make("div", { className: "elvis-cross", hidden: true });
    this.prompt = make("div", { className: "elvis-prompt", hidden: true, role: "status" });
    this.tip = make("div", { className: "elvis-tip", hidden: true, "aria-hidden": "true" });
    this.stage = make("div", { className: "elvis-stage", tabIndex: 0, role: "application", "aria-label": "picture: arrow keys turn, + and - zoom, shift and arrows pan, f fits, v moves a cross that reads values" },
      this.canvas, this.error, this.tip, this.prompt, this.proofLegend, this.cross);
    this.plots = new Plots(this);
    this.handles = new Handles(this);
    this.beside = new Beside(this);
    this.warp = new Warp(this);
    this.barGrips = new BarGrips(this);
    this.timeBar = new TimeBar(this);
    this.canvas.after(...this.warp.layers, ...this.beside.parts, this.barGrips.svg, this.handles.svg);
    this.panel = make("section", { className: "elvis-panel", ariaLabel: "settings" });
    this.tree = new DataTree(this);
    // a slider that is being dragged must stay in the page
    this.panel.addEventListener("pointerdown", (e) => { this.isSliding = e.target.type === "range" || Boolean(e.target.closest(".elvis-transfer")); });
    for (const kind of ["pointerup", "pointercancel"]) window.addEventListener(kind, () => { this.isSliding = false; });
    this.values = make("output", { "aria-label": "values under the pointer" });
    this.copyAll = make("button", { type: "button", hidden: true, title: "Copy the value, position and element with all digits", onclick: () => this.copyPicked() }, "copy all");
    this.counts = make("span", { role: "status" });
    this.busy = make("span", { className: "elvis-busy", hidden: true, ariaLabel: "activity" });
    this.root = make("div", { className: "elvis" }, this.tools(), make("div", { className: "elvis-side" }, this.tree.root, this.panel), this.stage, this.plots.root, make("div", { className: "elvis-status" }, this.busy, this.counts, this.copyAll, this.values));
    this.dialog = make("dialog", {});
    this.root.append(this.dialog);
    this.frame = make("div", { className: "elvis-frame" }, this.root);
    el.append(this.frame);
    this.waitFor();
    this.listen();
    this.watchTyping();
    new ResizeObserver(() => this.sized()).observe(this.stage);
    // another window may have resized the picture
    window.addEventListener("focus", () => this.size && this.stage.isConnected && this.resize(this.size));
  }

  tools() {
    const button = (text, title, act, name = text) => make("button", { type: "button", title, ariaLabel: name, onclick: act }, text);
    this.undoButton = button("↶", "Undo (Ctrl+Z)", () => this.model.send({ type: "undo" }), "undo");
    this.redoButton = button("↷", "Redo (Ctrl+Y)", () => this.model.send({ type: "redo" }), "redo");
    this.proofButton = button("proof", "Mark the pixels that are not certain", () => this.model.send({ type: "proof", on: this.proofButton.ariaPressed !== "true" }));
    const plotting = (mode, text, title) => button(text, title, () => this.setMode(this.mode === mode ? "turn" : mode));
    this.modes = { line: plotting("line", "line", "Click two points: plot exact values along a line"), section: plotting("section", "wall plot", "Click a wall: plot exact values along a section of it"), time: this.timeBar.values };
    const histogram = button("histogram", "Plot how much of the volume has which values", () => this.plots.add("histogram", { name: "all elements" }));
    this.freeButton = button("free", "Rotate freely instead of about the upright axis", () => { this.freeButton.ariaPressed = String(this.freeButton.ariaPressed !== "true"); });
    this.perspectiveButton = button("perspective", "Perspective or parallel view", () => this.look((camera) => projected(camera, !camera.fov)));
    for (const one of [this.proofButton, this.modes.line, this.modes.section, this.freeButton, this.perspectiveButton]) one.ariaPressed = "false";
    this.saving = make("select", { "aria-label": "save", onchange: (e) => this.save(e.target) },
      ...["save…", "picture .png", "figure .svg", "figure .pdf", "page .html", "record .npz", "record .exr", "scene .toml", "scene .yaml", "copy command", "copy Python", ...(this.model.restore ? ["copy link"] : [])].map((text) => make("option", {}, text)));
    const turnTo = (view) => {
      this.camera = null;
      this.refit = false;
      this.change({ camera: view });
    };
    const views = Object.entries(VIEWS).map(([text, view]) => button(text, `View ${view}: ${SENSES[view]}`, () => turnTo(view)));
    this.toggles = new Toggles(this);
    this.turning = [...views, this.perspectiveButton, this.freeButton];
    const data = button("data", "Data and objects on the left", () => {
      data.ariaPressed = String(!this.root.classList.toggle("elvis-without-tree"));
    });
    data.className = "elvis-data";
    data.ariaPressed = "true";
    this.menu = button("≡", "Data, objects and settings", () => this.open(!this.root.classList.contains("elvis-open")), "data, objects and settings");
    this.menu.className = "elvis-menu";
    this.menu.ariaExpanded = "false";
    const full = button("full screen", "Fill the screen, or return", () => (document.fullscreenElement ? document.exitFullscreen() : this.frame.requestFullscreen()));
    full.hidden = !document.fullscreenEnabled;
    const row = make("div", { className: "elvis-tool-row" }, this.menu, data, button("fit", "Fit the whole scene in this direction (f)", () => this.fit()), ...this.turning,
      this.toggles.root, this.modes.line, this.modes.section, histogram, this.proofButton, this.beside.choice, this.beside.second, this.beside.files, this.undoButton, this.redoButton, this.saving, full);
    return make("section", { className: "elvis-tools", ariaLabel: "tools" }, row, this.timeBar.root);
  }

  // the side of a narrow page, over the picture
  open(isOpen) {
    this.root.classList.toggle("elvis-open", isOpen);
    this.menu.ariaExpanded = String(isOpen);
    if (isOpen) this.tree.root.focus();
    else this.menu.focus();
  }

  // ---- messages

  receive(message, buffer) {
    const act = { schema: () => this.learn(message), state: () => this.update(message), frame: () => this.queue(message, buffer),
      answer: () => this.settle(message.id, buffer ?? message.content), error: () => this.fail(message), closed: () => this.lose(message) }[message.type];
    act?.();
  }

  learn({ schema, palettes }) {
    Object.assign(this, { schema, palettes });
    this.sized();
  }

  update({ table, facts, undo, redo, proof, revision, start, writes, stale, hidden, paper }) {
    this.sessionPaper = paper ?? null;
    Object.assign(this, { revision, hidden });
    // another view or other objects: their middle is not known yet
    if (!this.camera || JSON.stringify(table.camera) !== JSON.stringify(plain(this.camera))) this.middle = null;
    // facts from pictures and searches stay; controls hold this object, so update it in place
    if (facts) this.facts = Object.assign(this.facts ?? {}, facts);
    this.table = table;
    // 2D data have one side
    for (const one of this.turning) one.hidden = this.facts?.kind === "plane";
    this.undoButton.disabled = !undo;
    this.redoButton.disabled = !redo;
    this.proofButton.ariaPressed = String(proof);
    this.proofLegend.hidden = !proof;
    this.toggles.update();
    this.beside.update();
    if (this.root.dataset.final !== String(revision)) this.waitFor();
    if (start) this.darken();
    this.follow(start);
    this.controls();
    this.timeBar.update();
    this.handles.draw();
    this.offerWriting(writes);
    this.outdate(stale);
    if (start) {
      this.start = start;
      this.recover("connection");
      this.model.restore?.(this);
    }
  }

  ask(type, content, more = {}, buffers = []) {
    const id = ++counter;
    if (this.model.send({ type, id, content, ...more }, buffers) === false) return Promise.reject(new Error("Not connected to elvis view."));
    return new Promise((resolve, reject) => this.waiting.set(id, { resolve, reject }));
  }

  settle(id, content) {
    this.waiting.get(id)?.resolve(content);
    this.waiting.delete(id);
  }

  // show a message; it disappears with the next picture, with the picture of the next change, or when the connection is back
  fail({ id, text, until = "change", fit = false }) {
    if (this.waiting.has(id)) {
      this.waiting.get(id).reject(new Error(text));
      this.waiting.delete(id);
      return;
    }
    this.arrived();
    // a rejected change has not moved the camera
    if (!this.dragged && !this.rolling) {
      this.camera = null;
      this.warp.hide();
    }
    this.error.textContent = text;
    // an empty view gets a button to fit the scene
    if (fit) this.error.append(" ", make("button", { type: "button", title: "Fit the whole scene in this direction", onclick: () => this.fit() }, "fit"));
    this.error.hidden = false;
    this.failed = { until, revision: Math.max(this.revision ?? 0, this.drawn ?? 0) };
    this.controls();
  }

  // pictures and connections remove the messages that they resolve
  recover(event, revision = 0) {
    const { until, revision: last } = this.failed ?? {};
    if (until === event || (event === "picture" && until === "change" && revision > last)) this.error.hidden = true;
  }

  // files that were read have changed on disk since; shown once
  outdate(text = "") {
    if (text === this.stale) return;
    this.stale = text;
    this.recover("read");
    if (!text) return;
    this.fail({ text, until: "read" });
    this.error.append(" ", make("button", { type: "button", onclick: () => this.model.send({ type: "read again" }) }, "read again"));
  }

  // pending requests are never answered
  lose(message) {
    for (const { reject } of this.waiting.values()) reject(new Error(message.text));
    this.waiting.clear();
    this.fail(message);
  }

  change(changes, moving = false) {
    this.model.send({ type: "change", changes, moving });
  }

  // ---- pictures

  // pictures are shown in the order in which they arrive, however long each takes to decode
  queue(facts, buffer) {
    const bytes = new Uint8Array(buffer.buffer ?? buffer, buffer.byteOffset ?? 0, buffer.byteLength), end = facts.motion?.begin ?? bytes.length;
    const decoded = createImageBitmap(new Blob([bytes.subarray(0, end)]));
    const numbers = facts.motion ? unpacked(bytes.subarray(end)) : null;
    this.showing = Promise.all([decoded, numbers, this.showing]).then(([picture, found]) => this.show(facts, picture, found));
  }

  show(facts, picture, numbers) {
    this.model.send({ type: "shown" });
    this.drawn = facts.revision;
    this.recover("picture", facts.revision);
    const context = this.canvas.getContext("2d");
    if (facts.final || !this.picture || isOtherShape(facts.size, this.picture.image)) this.lay(facts);
    context.drawImage(picture, ...(facts.final ? [0, 0] : this.picture.image));
    if (!facts.final && facts.title !== this.title) this.retitle(facts.title);
    this.title = facts.title;
    if (facts.final) {
      this.told(facts);
      this.adjust();
    }
    this.frames = (this.frames ?? 0) + 1;
    if (this.facts && this.facts.shown !== facts.field) {
      this.facts.shown = facts.field;
      this.controls();
    }
    this.picture.camera = facts.camera;
    this.picture.ranges = facts.ranges;
    if (this.facts) this.facts.range = facts.ranges[facts.field];
    this.perspectiveButton.ariaPressed = String(Boolean(facts.camera.fov));
    this.root.dataset.final = facts.final ? facts.revision : "";
    if (facts.final) this.warp.keep();
    else this.warp.draft(facts, picture, numbers);
    picture.close();
    this.overlay();
    if (!facts.final) return this.beside.draft();
    for (const resume of this.resting.splice(0)) resume();
    // requests about the previous picture are repeated
    this.point(this.pointer);
    this.beside.ask();
    this.plots.follow();
    if (this.refit && !facts.camera.fov) this.look((camera) => projected(camera, true));
  }

  // a draft has no title, and the title of the previous picture may show another time
  retitle(text) {
    const context = this.canvas.getContext("2d"), [left, top, width] = this.picture.image;
    const [red, green, blue] = this.background;
    context.fillStyle = this.paper;
    context.fillRect(0, 0, left + width, top);
    context.fillStyle = 0.2126 * red + 0.7152 * green + 0.0722 * blue < 0.4 ? "rgb(235, 235, 235)" : "rgb(30, 30, 30)";
    Object.assign(context, { font: `${Math.round(0.45 * top)}px sans-serif`, textBaseline: "middle" });
    context.fillText(text, left, top / 2);
  }

  // tell what takes long until the picture at rest has come, or an error
  waitFor(what = this.facts ? "drawing" : "reading the data") {
    const begin = performance.now();
    clearInterval(this.watching);
    this.watching = setInterval(() => {
      const seconds = Math.floor((performance.now() - begin) / 1000);
      const compiles = what === "drawing" && seconds >= MANY_SECONDS ? "; the first picture of each kind compiles kernels, once" : "";
      this.busy.textContent = `${what}… ${seconds} s${compiles}`;
      this.busy.hidden = seconds < 1;
    }, 250);
  }

  arrived() {
    clearInterval(this.watching);
    this.busy.hidden = true;
  }

  told({ counts, remarks, folds }) {
    this.arrived();
    const shown = ["certain", "ambiguous", "failed"].filter((name) => counts[name] || name === "certain");
    this.counts.textContent = `pixels: ${shown.map((name) => `${counts[name].toLocaleString("en")} ${name}`).join(", ")}${folds ? "; the deformation folds elements" : ""}`;
    this.counts.title = remarks.join("\n");
  }

  // the page of a picture; a draft before any picture gets the page of the picture to come
  lay(facts) {
    const room = this.room, size = facts.final ? facts.size : room;
    Object.assign(this.canvas, { width: size[0], height: size[1] });
    this.picture = facts.final ? facts : { ...facts, size, image: imageWithin(facts.size, room) };
    this.stage.style.background = this.paper;
    this.fill();
  }

  // the background of the picture: the scene's, else that of the page
  get background() {
    return this.table.background ?? (this.isDark.matches ? DARK : [1, 1, 1]);
  }

  get paper() {
    const [red, green, blue] = this.background.map((part) => Math.round(255 * part));
    return `rgb(${red}, ${green}, ${blue})`;
  }

  // pictures of scenes without a background follow the theme of the page that was opened last
  darken() {
    const color = this.isDark.matches ? DARK : null;
    if (String(color) !== String(this.sessionPaper)) this.model.send({ type: "paper", color });
    this.sessionPaper = color;
  }

  // pixels of the screen available for the picture
  get room() {
    const ratio = window.devicePixelRatio || 1;
    const share = this.beside.isApart ? 0.5 : 1;
    return [this.stage.clientWidth * share, this.stage.clientHeight].map((side) => Math.floor(side * ratio));
  }

  // pixels of the picture per pixel of the page
  get density() {
    return this.canvas.width / (this.canvas.getBoundingClientRect().width || this.canvas.width);
  }

  // pixels of the picture equal those of the screen; a picture of another size, from before or from another window, is scaled to its area
  fill() {
    const { room, canvas } = this, part = Math.min(room[0] / canvas.width, room[1] / canvas.height);
    const isFitting = part >= 1 && part < 1.08;
    const scale = (isFitting ? 1 : part) / (window.devicePixelRatio || 1);
    Object.assign(canvas.style, { width: `${canvas.width * scale}px`, height: `${canvas.height * scale}px` });
  }

  // the size of an image whose page fills the stage: margins are proportional to the smaller side of the image
  sized() {
    const { room } = this;
    if (Math.min(...room) < 1) return;
    this.adjusted = 0;
    const { size, image } = this.picture?.final ? this.picture : FIRST;
    const margins = [size[0] - image[2], size[1] - image[3]];
    const part = Math.min(...room) / (Math.min(...image.slice(2)) + Math.max(...margins));
    this.resize(room.map((side, i) => side - margins[i] * part));
    if (!this.picture) return;
    this.fill();
    this.overlay();
  }

  // overlays of the picture follow its position
  overlay() {
    this.handles.draw();
    this.barGrips.draw();
    this.beside.place();
    this.warp.place();
  }

  // adjust the size once the picture has arrived: the widths of texts are known only then
  adjust() {
    const { room } = this, { size, image } = this.picture;
    const isOwn = this.size && image[2] === this.size[0] && image[3] === this.size[1];
    const lack = room.map((side, i) => side - size[i]);
    if (!isOwn || lack.every((one) => one >= 0 && one < SLACK) || this.adjusted >= 4) return;
    this.adjusted += 1;
    this.resize(lack.map((one, i) => image[2 + i] + one - SLACK / 4));
  }

  resize(size) {
    this.size = size.map((side) => Math.max(64, Math.floor(side)));
    clearTimeout(this.sizing);
    this.sizing = setTimeout(() => {
      this.sizing = 0;
      if (this.schema) this.model.send({ type: "size", size: this.size });
    }, 120);
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

  // The page's own camera is ahead of the scene's until that has caught up: pictures in transit show older ones.
  follow(isStart) {
    const isGesture = this.dragged || this.rolling;
    const isReached = this.camera && JSON.stringify(this.table.camera) === JSON.stringify(plain(this.camera));
    if (isStart || (isReached && !isGesture)) this.camera = null;
  }

  look(change, moving = false) {
    const camera = this.current();
    if (!camera) return;
    this.camera = change(camera);
    this.refit = false;
    if (!moving) {
      this.change({ camera: plain(this.camera) });
      this.warp.show(this.camera);
      return;
    }
    if (this.pending) return;
    this.pending = requestAnimationFrame(() => {
      this.pending = 0;
      if (!this.camera) return;
      this.change({ camera: plain(this.camera) }, true);
      this.warp.show(this.camera);
    });
  }

  // fit all that is shown in the current direction; a named view has its own direction
  fit() {
    this.centre = null;
    const camera = this.current();
    if (!camera || typeof (this.table.camera ?? "fit") === "string") return this.change({ camera: this.table.camera ?? "fit" });
    const { eye, at, up, fov } = camera;
    this.camera = null;
    // the fit is parallel; its perspective view follows, both as one step of undo
    this.refit = Boolean(fov);
    this.change({ camera: { eye, at, up } }, this.refit);
  }

  // a camera that fits itself to what is visible would move during a drag or when objects are added: fix it
  still() {
    const { camera } = this.table;
    return isFixed(camera) || !this.picture ? {} : { camera: plain(this.current()) };
  }

  // centre of rotation: a point that was chosen, else the middle of what was visible when the rotation began; if what is visible
  // reaches much deeper than the picture is wide, that middle may be far from what one looks at: the point under the pointer
  pivot(camera) {
    if (!this.middle) {
      const seen = this.warp.seen(camera), [, , ...size] = this.picture.image;
      const isDeep = seen?.size > DEEP * length(size) * frameOf(camera, this.pixels()).pixel;
      this.middle = (isDeep && this.dragged?.point) || seen?.middle || camera.at;
    }
    return this.centre ?? this.middle;
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
    const { canvas, stage } = this;
    canvas.addEventListener("pointerdown", (e) => this.press(e));
    canvas.addEventListener("pointerup", (e) => this.release(e));
    canvas.addEventListener("pointercancel", (e) => this.release(e));
    canvas.addEventListener("dblclick", (e) => this.recentre(e));
    // grips lie over the picture: what is under them can be picked and zoomed too
    stage.addEventListener("pointermove", (e) => (this.fingers.has(e.pointerId) ? this.finger(e) : this.dragged ? this.drag(e) : this.point(e)));
    stage.addEventListener("pointerleave", () => this.point(null));
    stage.addEventListener("wheel", (e) => this.wheel(e), { passive: false });
    stage.addEventListener("contextmenu", (e) => e.preventDefault());
    // a second dataset can be dropped on the picture
    const over = (isOver) => (e) => {
      if (!this.model.upload) return;
      e.preventDefault();
      stage.classList.toggle("elvis-dropping", isOver);
      if (e.type === "drop") this.beside.read([...e.dataTransfer.files]);
    };
    for (const [kind, isOver] of [["dragover", true], ["dragleave", false], ["drop", false]]) stage.addEventListener(kind, over(isOver));
    stage.addEventListener("keydown", (e) => this.key(e));
    this.root.addEventListener("keydown", (e) => e.key === "Escape" && this.root.classList.contains("elvis-open") && this.open(false));
  }

  press(event) {
    this.stage.focus();
    this.canvas.setPointerCapture(event.pointerId);
    if (event.pointerType === "touch") this.fingers.set(event.pointerId, event);
    if (this.fingers.size > 1) {
      this.dragged = null;
      this.pinch = this.pinched();
      return;
    }
    this.middle = null;
    this.point(null);
    this.dragged = { x: event.clientX, y: event.clientY, way: 0, point: this.warp.under(this.place(event)), isPan: event.button > 0 || event.shiftKey || this.facts?.kind === "plane" };
  }

  drag(event) {
    const ratio = this.density;
    const dx = event.clientX - this.dragged.x, dy = event.clientY - this.dragged.y;
    Object.assign(this.dragged, { x: event.clientX, y: event.clientY, way: this.dragged.way + Math.abs(dx) + Math.abs(dy) });
    if (this.dragged.way < 4 || !this.picture) return;
    const isFree = this.freeButton.ariaPressed === "true";
    const angle = Math.PI / (this.canvas.clientHeight || 1);
    this.look((camera) => this.dragged.isPan ? pan(camera, dx * ratio, dy * ratio, this.pixels())
      : orbit(camera, this.pivot(camera), dx * angle, dy * angle, isFree), true);
    if (this.dragged.isPan) this.middle = null;
  }

  // one finger drags; two move and zoom
  finger(event) {
    this.fingers.set(event.pointerId, event);
    if (!this.pinch) return this.dragged && this.drag(event);
    if (this.fingers.size < 2 || !this.picture) return;
    const last = this.pinch, now = this.pinch = this.pinched(), ratio = this.density;
    const [x, y] = this.place({ clientX: now.x, clientY: now.y }), [, , width, height] = this.picture.image;
    this.middle = null;
    this.look((camera) => {
      const moved = pan(camera, (now.x - last.x) * ratio, (now.y - last.y) * ratio, this.pixels());
      return zoom(moved, last.gap / now.gap, x - width / 2, y - height / 2, height);
    }, true);
  }

  // the middle of two fingers, and the distance between them
  pinched() {
    const [first, second] = this.fingers.values();
    return { x: (first.clientX + second.clientX) / 2, y: (first.clientY + second.clientY) / 2, gap: Math.max(1, Math.hypot(first.clientX - second.clientX, first.clientY - second.clientY)) };
  }

  release(event) {
    this.fingers.delete(event.pointerId);
    if (this.pinch) {
      // the finger that stays does nothing until it is lifted
      if (this.fingers.size) return;
      this.pinch = null;
      this.look((camera) => camera);
      return;
    }
    const drag = this.dragged;
    this.dragged = null;
    if (!drag) return;
    // the next picture tells the value where the pointer is now
    if (event.pointerType !== "touch") this.pointer = { clientX: event.clientX, clientY: event.clientY };
    if (drag.way < 4) this.click(event);
    else this.look((camera) => camera);
  }

  wheel(event) {
    event.preventDefault();
    if (!this.picture) return;
    const [x, y] = this.place(event), [, , width, height] = this.picture.image, ratio = this.density;
    // fingers on a trackpad that spread arrive as small steps with the control key
    const factor = Math.exp(Math.max(-60, Math.min(60, event.deltaY || event.deltaX)) / (event.ctrlKey ? 100 : 400));
    // a gesture stays what it began as
    if (!this.rolling) this.isPadded = !event.ctrlKey && isOfTrackpad(event);
    this.dragged = null;
    this.middle = null;
    this.look((camera) => (this.isPadded ? pan(camera, -event.deltaX * ratio, -event.deltaY * ratio, height)
      : zoom(camera, factor, x - width / 2, y - height / 2, height)), true);
    clearTimeout(this.rolling);
    this.rolling = setTimeout(() => {
      this.rolling = 0;
      this.look((camera) => camera);
    }, 150);
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
    if (this.crossKey(event)) return event.preventDefault();
    const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    const isPan = event.shiftKey || this.facts?.kind === "plane";
    if (way) this.look((camera) => isPan ? pan(camera, way[0] * 40, way[1] * 40, this.pixels())
      : orbit(camera, this.pivot(camera), way[0] * STEP, way[1] * STEP, this.freeButton.ariaPressed === "true"));
    else if (event.key === "+" || event.key === "=") this.look((camera) => zoom(camera, 0.8, 0, 0, this.pixels()));
    else if (event.key === "-") this.look((camera) => zoom(camera, 1.25, 0, 0, this.pixels()));
    else if (event.key === "f") this.fit();
    else if (event.key === "z" && (event.ctrlKey || event.metaKey)) this.model.send({ type: "undo" });
    else if (event.key === "y" && (event.ctrlKey || event.metaKey)) this.model.send({ type: "redo" });
    else return;
    event.preventDefault();
  }

  // a cross takes the place of the pointer: it is moved, reads values and clicks
  crossKey({ key, shiftKey }) {
    const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[key];
    const isShown = !this.cross.hidden;
    if (key === "Escape" || (key === "v" && isShown)) {
      this.setMode("turn");
      this.cross.hidden = true;
      this.point(null);
    } else if (key === "v") this.moveCross([0, 0]);
    else if (way && (isShown || this.mode !== "turn")) this.moveCross(times(shiftKey ? 4 * NUDGE : NUDGE, way));
    else if (key === "Enter" && isShown) this.click(this.crossPlace());
    else if (key === "c" && isShown) this.recentre(this.crossPlace());
    else return false;
    return true;
  }

  moveCross([dx, dy]) {
    const { clientWidth: width, clientHeight: height } = this.stage;
    const [x, y] = this.cross.hidden ? [width / 2, height / 2] : this.crossAt;
    this.crossAt = [Math.min(width, Math.max(0, x + dx)), Math.min(height, Math.max(0, y + dy))];
    this.cross.hidden = false;
    Object.assign(this.cross.style, { left: `${this.crossAt[0]}px`, top: `${this.crossAt[1]}px` });
    this.point(this.crossPlace());
  }

  crossPlace() {
    const box = this.stage.getBoundingClientRect();
    return { clientX: box.left + this.crossAt[0], clientY: box.top + this.crossAt[1] };
  }

  // ---- values

  // what the final picture shows under the pointer: drafts have no answer, and a picture that arrives in between shows something else
  async pick(event) {
    const [column, row] = this.place(event).map(Math.floor);
    for (;;) {
      if (!this.isWhole) await this.rest();
      const { number } = this.picture;
      const found = await this.ask("pick", { row, column, number }).catch(() => ({ element: -1 }));
      if (found) return found;
      // another picture has been drawn, and is in transit or here
      if (this.picture.number === number) await this.rest();
    }
  }

  // wait for the next final picture
  rest() {
    return new Promise((resume) => this.resting.push(resume));
  }

  get isWhole() {
    return Boolean(this.root.dataset.final);
  }

  point(event) {
    // a value found elsewhere is not the value at this position
    this.tip.hidden = true;
    this.pointer = event ? { clientX: event.clientX, clientY: event.clientY } : null;
    this.hover();
  }

  // value under the pointer, updated when another picture arrives; one request at a time, the last one is answered
  async hover() {
    if (this.isPicking) return;
    this.isPicking = true;
    let asked = null;
    while (this.pointer && this.isWhole && asked !== this.pointer) {
      asked = this.pointer;
      const found = await this.pick(asked);
      this.tell(found);
      if (this.pointer === asked) this.hint(found, asked);
    }
    this.isPicking = false;
  }

  // six digits in the row below the picture; *copy all* has the others
  tell(found) {
    if (!found || found.element < 0) {
      this.values.textContent = "";
      return;
    }
    this.picked = found;
    this.copyAll.hidden = false;
    const place = found.position.map(short).join(", ");
    const more = (found.order ?? null) === null ? "" : `  order ${found.order}  Jacobian ${short(found.jacobian)}`;
    this.values.textContent = `${found.field} = ${short(found.value ?? "not a number")}  at (${place})  element ${found.element}${more}  ${found.status}`;
  }

  // six digits of the value next to the pointer
  hint(found, { clientX, clientY }) {
    this.tip.hidden = !(found?.element >= 0) || typeof found.value !== "number";
    if (this.tip.hidden) return;
    this.tip.textContent = short(found.value);
    const box = this.stage.getBoundingClientRect();
    const left = Math.min(clientX - box.left + 14, box.width - this.tip.offsetWidth - 4);
    Object.assign(this.tip.style, { left: `${left}px`, top: `${Math.max(2, clientY - box.top - 26)}px` });
  }

  // copy the last picked point for tables, a name and a value per line
  copyPicked() {
    const { field, value, position, element, order, jacobian, status } = this.picked;
    const rows = { [field]: value ?? "not a number", x: position[0], y: position[1], z: position[2], element, order, jacobian, status };
    const text = Object.entries(rows).filter(([, own]) => (own ?? null) !== null).map((pair) => pair.join("\t")).join("\n");
    return this.give("values", text);
  }

  // what a click does: nothing more than to turn, or to choose what is plotted
  setMode(mode) {
    this.mode = mode;
    this.line = [];
    for (const [name, button] of Object.entries(this.modes)) button.ariaPressed = String(mode === name);
    this.guide();
    if (mode !== "turn") this.stage.focus({ preventScroll: true });
  }

  guide() {
    const texts = { line: ["Click the start of the line", "Click the end of the line"], section: ["Click a wall"], time: ["Click a point"] };
    const text = texts[this.mode]?.[this.line.length];
    this.prompt.hidden = !text;
    this.prompt.textContent = text ? `${text} (or arrow keys and Enter; Esc cancels)` : "";
  }

  async click(event) {
    const found = await this.pick(event), { mode } = this;
    this.tell(found);
    if (mode === "turn" || !found?.position) return;
    if (mode === "line" && !this.line.length) {
      this.line.push(found.position);
      return this.guide();
    }
    const [start] = this.line, place = found.position;
    this.setMode("turn");
    const near = (point) => `(${point.slice(0, this.facts.kind === "plane" ? 2 : 3).map((one) => Number(one.toPrecision(3))).join(", ")})`;
    if (mode === "line") await this.plots.add("line", { start, end: place, name: `${near(start)} to ${near(place)}` });
    else await this.plots.add(mode, { place, name: near(place) });
  }

  // ---- objects and their settings

  controls() {
    if (!this.schema || !this.facts || this.isSliding) return;
    const check = (text) => this.ask("check", text).then(() => null, (error) => error.message);
    const make_ = this.makers = new Controls(this.schema, this.facts, this.palettes, check);
    const section = (title, names) => [make("h2", {}, title), ...names.map((name) =>
      make_.row(name, this.schema.properties[name], this.table[name], (value, moving) => this.change({ [name]: value ?? null }, moving)))];
    this.refill(this.panel, [...this.objects(make_), ...this.states(), ...this.copies(make_), ...section("Colour", COLOUR), this.peaks(), ...(this.facts.times?.length > 1 ? section("Time", ["between"]) : []), ...section("Light", LIGHT), ...section("Figure", FIGURE)]);
    this.tree.update();
  }

  // other contents of a part of the page; scroll positions, folds, the focus and a text that is being typed stay
  refill(root, children) {
    const active = root.getRootNode().activeElement, scrolled = [root, root.parentElement].map((one) => [one, one?.scrollTop]);
    const focused = root.contains(active) ? this.nameOf(active, root) : null;
    const typed = focused && active.isTyped ? { text: active.value, caret: [active.selectionStart, active.selectionEnd] } : null;
    // browsers report a change where a field with another text than before is removed
    if (typed) Object.assign(active, { isTyped: false, value: active.before });
    root.replaceChildren(...children);
    Controls.restore(root);
    for (const [one, top] of scrolled) if (one) one.scrollTop = top;
    const next = focused && this.focusable(root).find((one) => this.nameOf(one, root) === focused);
    next?.focus({ preventScroll: true });
    if (next && typed) this.retype(next, typed);
  }

  // continue a text that was being typed in a field that has been replaced
  retype(field, { text, caret }) {
    field.value = text;
    // fields of numbers have no caret to set
    if (caret[0] !== null) field.setSelectionRange(...caret);
    field.dispatchEvent(new Event("input", { bubbles: true }));
  }

  // Fields know whether their text is being typed.  Browsers report no change of a text that a program has put there.
  watchTyping() {
    const apply = ({ target }) => target.isTyped && target.dispatchEvent(new Event("change", { bubbles: true }));
    this.root.addEventListener("focusin", ({ target }) => { target.before = target.value; });
    this.root.addEventListener("input", ({ target }) => { target.isTyped = ["text", "number"].includes(target.type); });
    this.root.addEventListener("change", ({ target }) => { target.isTyped = false; }, true);
    this.root.addEventListener("focusout", apply);
    this.root.addEventListener("keyup", (e) => e.key === "Enter" && apply(e));
  }

  // certified minimum and maximum of the field: marked, reported, and where new objects are placed
  peaks() {
    const button = (text, number) => make("button", { type: "button", title: `Mark the ${text} of the field; new planes pass through it`, onclick: () => this.findPeak(number) }, text);
    return make("div", { className: "elvis-row" }, make("label", {}, "find"), make("div", { className: "elvis-several" }, button("minimum", 0), button("maximum", 1)));
  }

  async findPeak(number) {
    try {
      this.peak = (await this.ask("extrema", this.table.field || this.picture?.field))[number];
      this.facts.place = this.peak.position;
      this.tell(this.peak);
      this.handles.draw();
    } catch (error) {
      this.fail({ text: error.message });
    }
  }

  focusable(root) {
    return [...root.querySelectorAll("input,select,button,summary,[tabindex]")];
  }

  // name of a control from the folds around it, to find it again after controls are recreated
  nameOf(element, root) {
    const own = (one) => `${one.tagName} ${one.getAttribute("aria-label") ?? one.labels?.[0]?.textContent ?? one.textContent}`;
    const name = [own(element), ...foldsAround(element)].join("/");
    const twins = [...(element.closest("details") ?? root).querySelectorAll(element.tagName)].filter((one) => own(one) === own(element));
    return `${name}/${twins.indexOf(element)}`;
  }

  // all objects and clips; the shortcut `plane` is the first object
  listed() {
    const own = this.table.objects ?? [];
    const first = this.table.plane ? [{ key: "plane", item: { kind: "cut", surface: { kind: "plane", ...this.table.plane } } }] : [];
    const clips = (this.table.clip ?? []).map((item, i) => ({ key: `clip[${i}]`, item: { kind: "clip", ...item } }));
    return [...first, ...own.map((item, i) => ({ key: `objects[${i}]`, item, number: i })), ...clips];
  }

  // the scale of a deformation and the phase of complex fields
  states() {
    const { deform, phase } = this.table, rows = [];
    if (deform) {
      const scale = deform.scale ?? 1, most = Math.max(this.mostScale ?? 0, 2 * Math.abs(scale)) || 1;
      // the ends stay while the slider moves between them
      this.mostScale = most;
      rows.push(this.sliderWithField("scale", -most, most, scale, (value, moving) => this.change({ "deform.scale": value }, moving)));
    }
    if (phase !== undefined || this.facts.complex?.length) {
      rows.push(this.sliderWithField("phase", 0, 360, phase ?? 0, (value, moving) => this.change({ phase: value }, moving)));
    }
    return rows.length ? [make("h2", {}, deform ? "Deformation" : "Phase"), ...rows] : [];
  }

  // mirrors, turns and repetitions, and what can be added; an empty table of copies is none
  copies(controls) {
    if (this.facts.kind === "line" || !this.facts.box) return [];
    const { properties } = controls.resolve({ $ref: "#/$defs/Copies" });
    const own = this.table.copies ?? {};
    const put = (name, list, moving) => {
      const next = Object.fromEntries(Object.entries({ ...own, [name]: list }).filter(([, each]) => each.length));
      this.change({ copies: Object.keys(next).length ? next : null }, moving);
    };
    const rows = Object.entries(properties).flatMap(([name, { items }]) => (own[name] ?? []).map((item, i, every) => {
      const set = (value, moving) => put(name, every.map((old, k) => (k === i ? value : old)), moving);
      const remove = make("button", { type: "button", title: "Remove these copies", onclick: () => put(name, every.filter((_, k) => k !== i)) }, "delete");
      return controls.fold(`${name} ${i + 1}`, "", [make("div", { className: "elvis-buttons" }, remove), ...controls.rows(controls.resolve(items), item, set)], true);
    }));
    const offered = this.offeredCopies();
    const add = (e) => {
      const [, name, item] = offered[e.target.selectedIndex - 1];
      put(name, [...(own[name] ?? []), item]);
    };
    const adding = make("select", { "aria-label": "add copies", onchange: (e) => e.target.selectedIndex && add(e) },
      make("option", {}, "add…"), ...offered.map(([text]) => make("option", {}, text)));
    return [make("h2", {}, "Copies"), ...rows, adding];
  }

  // copies to choose from: mirrors at the sides of the data, turns, and repetitions by declared periods or by the extent
  offeredCopies() {
    const { box, periods = {}, kind } = this.facts, isFlat = kind === "plane", extent = length(minus(box[1], box[0]));
    // without rounding next to zero
    const [low, high] = box.map((corner) => corner.map((one) => (Math.abs(one) < 1e-12 * extent ? 0 : one)));
    const along = (axis, size) => [0, 1, 2].map((k) => (k === axis ? size : 0));
    const axes = ["x", "y", "z"].map((name, axis) => ({ name, axis, size: high[axis] - low[axis] }));
    const inSpace = isFlat ? axes.slice(0, 2) : axes;
    const mirrors = inSpace.flatMap(({ name, axis }) => [...new Set([low[axis], high[axis]])].map((end) =>
      [`mirror at ${name} = ${short(end)}`, "mirror", { point: along(axis, end), normal: along(axis, 1) }]));
    const turns = (isFlat ? axes.slice(2) : axes).map(({ name, axis }) => [`turn about ${name}`, "turn", { axis: along(axis, 1), count: 2 }]);
    const repeats = inSpace.filter(({ name, size }) => name in periods || size > 0).map(({ name, axis, size }) => (name in periods ?
      [`repeat along ${name}, period ${short(periods[name])}`, "repeat", { step: name, count: 2 }] :
      [`repeat along ${name}`, "repeat", { step: along(axis, size), count: 2 }]));
    return [...mirrors, ...turns, ...repeats];
  }

  objects(controls) {
    const items = this.schema.properties.objects.items;
    const schemaOf = (kind) => controls.resolve({ $ref: items.discriminator.mapping[kind] ?? this.schema.properties.clip.items.$ref });
    const rows = this.listed().map(({ key, item, number }, place) => {
      const set = (value, moving) => (key === "plane" && value.style ? this.setFirst(value, moving) : this.change({ [key]: this.kept(key, value) }, moving));
      controls.hidden = ["streamlines", "glyphs"].includes(item.kind) ? ON_SURFACES : null;
      const button = (text, title, act) => make("button", { type: "button", title, onclick: act }, text);
      const buttons = make("div", { className: "elvis-buttons" });
      if (number !== undefined) buttons.append(button("duplicate", "Add a copy", () => this.add(item)));
      if (this.canBeHeld(item)) buttons.append(this.handleButton(key === "plane" ? key : `${key}.surface`));
      buttons.append(button("delete", "Remove the object", () => { this.selected = null; this.change({ [key]: null }); }));
      return controls.fold(`${place + 1} ${item.kind}`, this.summary(item), [buttons, ...this.sliders(item, set), ...this.transfer(key, item, controls), ...controls.rows(schemaOf(item.kind), item, set)], true);
    });
    return rows.length ? [make("h2", {}, "Settings of objects"), ...rows] : [];
  }

  // the list of objects that can be added
  adding() {
    const kinds = this.facts.kind === "solid" ? ["plane", "sphere", "cylinder", "cone", "faces", "isosurface", "volume", "streamlines", "glyphs", "clip"] : ["faces", "streamlines", "glyphs"];
    return make("select", { "aria-label": "add an object", onchange: (e) => { if (e.target.selectedIndex) this.create(e.target.value); e.target.selectedIndex = 0; } },
      make("option", {}, "add…"), ...kinds.map((kind) => make("option", {}, kind)));
  }

  // the settings of an object, in the panel
  openObject(place) {
    const fold = [...this.panel.querySelectorAll(":scope > details")][place];
    fold.open = true;
    fold.scrollIntoView({ block: "nearest" });
    fold.firstChild.focus({ preventScroll: true });
  }

  // the editor of a volume's transfer function; the histogram appears once it is computed
  transfer(key, item, controls) {
    if (item.kind !== "volume") return [];
    const quantity = item.quantity ?? this.shown();
    const known = this.counted(quantity);
    if (known === undefined) this.count(quantity).then(() => this.controls());
    return [new TransferEditor(item.transfer, known, controls.extent(), (transfer, moving) => this.change({ [`${key}.transfer`]: transfer }, moving)).element];
  }

  // the histogram of a quantity at the current time: null if there is none, undefined before it is requested
  counted(quantity) {
    return this.histograms.get(this.momentOf(quantity));
  }

  momentOf(quantity) {
    const { step, time } = this.table;
    return JSON.stringify([quantity, step, time]);
  }

  async count(quantity) {
    const moment = this.momentOf(quantity);
    if (this.histograms.get(moment)) return;
    this.histograms.set(moment, null);
    this.histograms.set(moment, await this.ask("histogram", quantity).catch(() => null));
  }

  // the shortcut for a plane has no style: with one it becomes the first object
  setFirst(item, moving) {
    if (this.selected === "plane") this.selected = "objects[0].surface";
    this.change({ plane: null, objects: [item, ...(this.table.objects ?? [])] }, moving);
  }

  // an object in the form that the scene stores
  kept(key, item) {
    if (key === "plane") return item.surface;
    const { kind, ...rest } = item;
    return kind === "clip" ? rest : item;
  }

  canBeHeld(item) {
    return this.facts.kind === "solid" && ["plane", "sphere", "cylinder", "cone"].includes(item.surface?.kind);
  }

  handleButton(key) {
    const press = () => this.select(this.selected === key ? null : key);
    const own = make("button", { type: "button", title: "Show a handle for dragging in the picture", onclick: press }, "handle");
    own.ariaPressed = String(this.selected === key);
    return own;
  }

  // select a surface by its key; the picture then shows its handle
  select(key) {
    this.selected = key;
    this.controls();
    this.handles.draw();
  }

  summary(item) {
    const values = item.values ?? item.transfer?.values;
    const parts = [item.surface?.kind, item.along, item.quantity, values?.map(short).join(", "), (item.select ?? item.seeds ?? item.points)?.join(", "), item.style?.quantity];
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
      return [this.slider("offset", low, high, at, move), ...this.angles(item, normal, set)];
    }
    if (item.surface?.kind === "sphere" && box) return this.sphereSliders(item, box, set);
    if (item.kind === "isosurface" && item.values?.length === 1) {
      const quantity = item.quantity ?? this.shown(), { low, high } = this.counted(quantity) ?? {};
      const known = low < high ? [low, high] : this.picture?.ranges?.[quantity] ?? [item.values[0] - 1, item.values[0] + 1];
      return [this.slider("value", Math.min(known[0], item.values[0]), Math.max(known[1], item.values[0]), item.values[0],
        (e, moving) => set({ ...item, values: [Number(e.target.value)] }, moving))];
    }
    return [];
  }

  // the direction of a plane as longitude and latitude of its normal; it turns about its point in the box
  angles(item, normal, set) {
    const degree = Math.PI / 180;
    const around = Math.atan2(normal[1], normal[0]), above = Math.asin(Math.max(-1, Math.min(1, normal[2])));
    const at = (a, b) => [Math.cos(b) * Math.cos(a), Math.cos(b) * Math.sin(a), Math.sin(b)];
    const turn = (next, moving) => set({ ...item, surface: { ...item.surface, normal: next } }, moving);
    // at the poles the longitude is undefined: sliders stop just before them
    const most = 89.999;
    return [this.slider("turn", -180, 180, around / degree, (e, moving) => turn(at(Number(e.target.value) * degree, Math.max(-most * degree, Math.min(most * degree, above))), moving)),
      this.slider("tilt", -most, most, above / degree, (e, moving) => turn(at(around, Number(e.target.value) * degree), moving))];
  }

  sphereSliders(item, box, set) {
    const { center, radius } = item.surface;
    const extent = length(minus(box[1], box[0]));
    const put = (change, moving) => set({ ...item, surface: { ...item.surface, ...change } }, moving);
    const places = ["x", "y", "z"].map((name, axis) => this.slider(`center ${name}`, Math.min(box[0][axis], center[axis]), Math.max(box[1][axis], center[axis]), center[axis],
      (e, moving) => put({ center: center.map((old, i) => (i === axis ? Number(e.target.value) : old)) }, moving)));
    const size = this.slider("radius", extent / 500, Math.max(extent, radius), radius, (e, moving) => put({ radius: Number(e.target.value) }, moving));
    return [...places, size];
  }

  // a slider, and a field for any number
  sliderWithField(name, low, high, value, set) {
    const field = make("input", { type: "number", step: "any", value, "aria-label": `${name} value`,
      onchange: (e) => e.target.value !== "" && set(Number(e.target.value), false) });
    const move = (e, moving) => {
      field.value = e.target.value;
      set(Number(e.target.value), moving);
    };
    const row = this.slider(name, low, high, value, move);
    row.append(make("div", { className: "elvis-several" }, row.lastChild, field));
    return row;
  }

  slider(name, low, high, value, move) {
    const id = `elvis-${++counter}`;
    return make("div", { className: "elvis-row" }, make("label", { htmlFor: id }, name),
      make("input", { id, type: "range", min: low, max: high, step: (high - low) / 500 || 1, value,
        oninput: (e) => move(e, true), onchange: (e) => move(e, false) }));
  }

  // the view and what is visible stay unchanged, as a background of the new object
  add(item, more = this.still()) {
    const { objects = [], plane } = this.table, { bodies = [], kind } = this.facts;
    const put = (...items) => this.change({ ...Object.fromEntries(items.map((one, i) => [`objects[${objects.length + i}]`, one])), ...more });
    // 2D data are shown by themselves while they have no objects
    if (kind !== "solid" && !objects.length && !plane && item.kind !== "faces") return put({ kind: "faces", select: ["all"] }, item);
    const isBodies = bodies.length && objects.length === 1 && objects[0].kind === "faces" && !objects[0].style && String(objects[0].select) === String(bodies);
    if (isBodies && item.kind !== "faces") more = { ...more, "objects[0].style": { color: GREY } };
    put(item);
  }

  // a new object, placed where the camera looks
  async create(kind) {
    const controls = this.makers;
    await this.survey();
    if (kind in SURFACES) return this.createSurface(kind, controls);
    if (kind === "faces") return this.add({ kind: "faces", select: ["all"] }, {});
    // on 2D data, whose colours are those of the field, lines and glyphs are dark
    const isPlane = this.facts.kind === "plane", dark = isPlane ? { style: { color: INK } } : {};
    // tubes as thick as suits what is visible: the whole data may be much larger
    const girth = isPlane ? { width: 1.5 } : { radius: Number((controls.extent() / TUBES).toPrecision(2)) };
    if (kind === "streamlines") return this.add({ kind: "streamlines", seeds: [controls.seedText("random")], direction: "both", ...girth, ...dark });
    if (kind === "glyphs") return this.add({ kind: "glyphs", points: ["random:200"], ...dark });
    const [low, high] = await this.spread();
    if (kind === "isosurface") this.add({ kind: "isosurface", values: [(low + high) / 2] });
    else this.add({ kind: "volume", transfer: rareEnd(low, high, this.counted(this.shown())?.shares ?? [], controls.extent(this.facts.box)) });
  }

  // minimum and maximum of the shown quantity in its histogram, over all elements; else of those in the picture
  async spread() {
    const quantity = this.shown();
    await this.count(quantity);
    const { low, high } = this.counted(quantity) ?? {};
    return low < high ? [low, high] : this.picture?.ranges?.[quantity] ?? [0, 1];
  }

  // the quantity that colours the picture
  shown() {
    return this.table.field || this.picture?.field || this.facts.fields[0] || "x";
  }

  // a cut; or a clip, which removes the nearer half of what is visible
  createSurface(kind, controls) {
    const surface = { kind: SURFACES[kind].toLowerCase(), ...controls.start(this.schema.$defs[SURFACES[kind]]) };
    const list = kind === "clip" ? "clip" : "objects";
    this.selected = `${list}[${(this.table[list] ?? []).length}].surface`;
    if (kind !== "clip") return this.add({ kind: "cut", surface });
    const away = Math.sign(dot(surface.normal, this.facts.forward ?? [0, 0, 1])) || 1;
    const clip = { surface: { ...surface, normal: times(away, surface.normal) } };
    this.change({ [`clip[${(this.table.clip ?? []).length}]`]: clip, ...this.still() });
  }

  // what is visible, and the viewing direction: where new objects are placed
  async survey() {
    const camera = this.current();
    this.facts.forward = camera && frameOf(camera, 1).forward;
    this.facts.seen = await this.ask("seen", null).catch(() => null);
  }

  // ---- files

  save(select) {
    const chosen = select.value;
    select.selectedIndex = 0;
    if (chosen === "here…") this.writeHere();
    else if (chosen.startsWith("copy")) this.copy(chosen.slice(5));
    else if (chosen.startsWith("scene")) this.keep(`.${chosen.split(".").pop()}`).catch((error) => this.fail({ text: error.message }));
    else this.saveAs(chosen);
  }

  async keep(suffix, how = {}) {
    const file = await this.model.file(suffix, how, this);
    make("a", { href: URL.createObjectURL(file), download: `${this.facts?.name ?? "elvis"}${suffix}` }).click();
  }

  // a picture or a record: of the size that is shown, or of any other one
  saveAs(chosen) {
    const number = (name, value, most) => make("input", { type: "number", value, min: 1, max: most, step: 1, "aria-label": name, required: true });
    const [width, height] = this.picture?.image.slice(2) ?? [900, 700];
    const fields = [number("width", width, 8192), number("height", height, 8192), number("samples", this.table.samples ?? 1, 16)];
    const note = make("p", { className: "elvis-copied", role: "status" });
    const form = make("form", { method: "dialog" }, make("p", {}, `Save the ${chosen}, rendered at this size`),
      make("div", { className: "elvis-row" }, make("label", {}, "pixels"), make("div", { className: "elvis-several" }, fields[0], "×", fields[1])),
      make("div", { className: "elvis-row", title: "Supersampling: average N x N samples per pixel" }, make("label", {}, "samples"), fields[2]),
      ...(chosen === "page .html" ? this.pageFields(fields) : []), note, make("div", { className: "elvis-buttons" }, make("button", { type: "submit" }, "save"), make("button", { type: "button", onclick: () => this.dialog.close() }, "close")));
    form.addEventListener("submit", async (e) => {
      e.preventDefault();
      note.textContent = "drawing…";
      const [own, other, samples, directions, steps] = fields.map((field) => (field.type === "checkbox" ? Number(field.checked) : Number(field.value)));
      const views = directions ? { directions, all_steps: steps ?? 0 } : {};
      try {
        await this.keep(`.${chosen.split(".").pop()}`, { size: [own, other], samples, ...views });
        this.dialog.close();
      } catch (error) {
        note.textContent = error.message;
      }
    });
    this.dialog.replaceChildren(form);
    this.dialog.showModal();
    fields[0].select();
  }

  // a page may hold views from several directions and at all steps: further fields of the dialog
  pageFields(fields) {
    const turns = make("input", { type: "number", value: 1, min: 1, max: 360, step: 1, "aria-label": "directions", required: true });
    const steps = make("input", { type: "checkbox", "aria-label": "all steps" });
    fields.push(turns, steps);
    const row = (name, title, field) => make("div", { className: "elvis-row", title }, make("label", {}, name), field);
    const isFlat = this.facts.kind === "plane", isStill = this.timeBar.times.length < 2;
    return [...(isFlat ? [] : [row("directions", "Number of views around the up axis", turns)]), ...(isStill ? [] : [row("all steps", "A view at each step of the series", steps)])];
  }

  offerWriting(may) {
    const option = [...this.saving.options].find((one) => one.value === "here…");
    if (may && !option) this.saving.append(make("option", {}, "here…"));
    if (!may) option?.remove();
  }

  // into the folder of the data, where elvis view runs; existing files are replaced after confirmation
  writeHere() {
    const field = make("input", { type: "text", value: "picture.png", spellcheck: false, "aria-label": "name of the file" });
    const note = make("p", { className: "elvis-copied", role: "status" });
    const button = (text, act) => make("button", { type: "button", onclick: act }, text);
    const write = async (confirmed) => {
      note.textContent = "…";
      replace.hidden = true;
      try {
        const { question, wrote } = await this.ask("write", { name: field.value, confirmed });
        note.textContent = question ?? `wrote ${wrote}`;
        replace.hidden = !question;
      } catch (error) {
        note.textContent = error.message;
      }
    };
    const replace = button("replace", () => write(true));
    replace.hidden = true;
    field.addEventListener("input", () => { replace.hidden = true; });
    field.addEventListener("keydown", (e) => e.key === "Enter" && write(false));
    const told = make("p", {}, "Picture, record or scene in the folder of the data or below: .png, .svg, .pdf, .html, .exr, .npz, .toml, .yaml");
    this.dialog.replaceChildren(told, field, note,
      make("div", { className: "elvis-buttons" }, button("write", () => write(false)), replace, button("close", () => this.dialog.close())));
    this.dialog.showModal();
    field.select();
  }

  // a command, script or link that reproduces this picture: to the clipboard, and shown in a dialog
  async copy(language) {
    try {
      if (language === "link") return this.give(language, this.model.link(this));
      this.give(language, await this.ask("copy", language));
    } catch (error) {
      this.fail({ text: error.message });
    }
  }

  async give(title, text) {
    const field = make("textarea", { value: text, readOnly: true, cols: 80, spellcheck: false, "aria-label": title });
    const note = make("span", { className: "elvis-copied" });
    const close = make("button", { type: "button", onclick: () => this.dialog.close() }, "close");
    this.dialog.replaceChildren(field, make("div", { className: "elvis-buttons" }, close, note));
    this.dialog.showModal();
    // long lines are wrapped: show all of them, from the first
    field.style.height = `${field.scrollHeight + 4}px`;
    field.select();
    field.scrollTop = 0;
    // if the browser denies access to the clipboard, the text stays selected
    const isCopied = await navigator.clipboard?.writeText(text).then(() => true, () => false);
    note.textContent = isCopied ? "copied" : "press Ctrl+C to copy";
  }
}

// ---------------------------------------------------------------- a notebook's model, in the form of anywidget

//: bytes of a message that carries a part of a file
const PART = 1 << 22;

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

  send(message, buffers) {
    this.model.send(message, undefined, buffers);
  }

  // files of a second dataset, in parts that the connection of a notebook takes
  async upload(files, viewer) {
    for (const file of files) {
      for (let offset = 0; offset === 0 || offset < file.size; offset += PART) {
        const part = await file.slice(offset, offset + PART).arrayBuffer();
        await viewer.ask("upload", { name: file.name, first: file === files[0], offset }, {}, [part]);
      }
    }
    await viewer.ask("compare", null);
  }

  async file(suffix, how, viewer) {
    const content = await viewer.ask("save", how, { suffix });
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

// ---------------------------------------------------------------- links: the view in the fragment of an address, which browsers do not send

const LONGEST_LINK = 4000;

// the view, and all other keys that differ from those at the start, if they are short
function fragmentOf(table, start) {
  const values = { ...table, camera: table.camera ?? "fit" };
  const names = new Set([...Object.keys(values), ...Object.keys(start)]);
  const changed = [...names].filter((name) => JSON.stringify(values[name]) !== JSON.stringify(start[name]));
  const write = (some) => String(new URLSearchParams(some.map((name) => [name, JSON.stringify(values[name] ?? null)])));
  const all = write(["camera", ...changed.filter((name) => name !== "camera")]);
  return all.length > LONGEST_LINK ? write(["camera"]) : all;
}

// changes of a table; missing keys need not be removed
function changesOf(fragment, table) {
  const found = [...new URLSearchParams(fragment)].map(([name, text]) => {
    try {
      return [name, JSON.parse(text)];
    } catch (error) {
      throw new Error(`Invalid link: expected JSON, found ${name}=${text.slice(0, 60)}`);
    }
  });
  return Object.fromEntries(found.filter(([name, value]) => value !== null || name in table));
}

// ---------------------------------------------------------------- the page's own model: a socket that reconnects

class Socket {
  constructor() {
    this.token = new URLSearchParams(location.search).get("token") ?? "";
    this.delay = 250;
    window.addEventListener("hashchange", () => this.restore(this.viewer));
  }

  link({ table, start }) {
    return `${location.href.split("#")[0]}#${fragmentOf(table, start)}`;
  }

  // the view from the address, once; the server validates it like any change
  restore(viewer) {
    this.viewer = viewer;
    const fragment = location.hash.slice(1);
    if (!fragment) return;
    history.replaceState(null, "", location.href.split("#")[0]);
    try {
      viewer.change(changesOf(fragment, viewer.table));
    } catch (error) {
      viewer.fail({ text: error.message });
    }
  }

  address(path) {
    const url = new URL(path, location.href);
    url.searchParams.set("token", this.token);
    return url.href;
  }

  async file(suffix, { size, ...more }) {
    const asked = new URL(this.address(`save/elvis${suffix}`));
    if (size) asked.searchParams.set("size", size.join("x"));
    for (const [name, value] of Object.entries(more)) if (value) asked.searchParams.set(name, value);
    const answer = await fetch(asked);
    if (!answer.ok) throw new Error(await answer.text());
    return answer.blob();
  }

  // files of a second dataset
  async upload(files) {
    const body = new FormData();
    for (const file of files) body.append("file", file, file.name);
    const answer = await fetch(this.address("compare"), { method: "POST", body });
    if (!answer.ok) throw new Error(await answer.text());
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
      this.handler({ type: "closed", until: "connection", text: "Connection lost; reconnecting. Check that elvis view is still running." });
      setTimeout(() => this.open(), this.delay);
      this.delay = Math.min(8000, 2 * this.delay);
    };
  }

  // false if there is no connection
  send(message) {
    const isOpen = this.socket?.readyState === WebSocket.OPEN;
    if (isOpen) this.socket.send(JSON.stringify(message));
    return isOpen;
  }
}

if (document.body?.classList.contains("elvis-page")) {
  window.elvis = new Viewer(new Socket(), document.body);
}
