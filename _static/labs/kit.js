// What the laboratories share: plots in SVG, handles that pointer, touch and keys can drag, native controls, and a state
// that lives in the page's address.  Like engine.js a classic script; it defines one name, `labs`.
globalThis.labs = (() => {
  "use strict";

  const SVG = "http://www.w3.org/2000/svg";
  const all = {}; // the laboratories of this page by id
  const phone = matchMedia("(max-width: 700px)"); // as in labs.css
  const still = matchMedia("(prefers-reduced-motion: reduce)");

  /** An element with attributes and children; children may be text. */
  function make(space, tag, attributes = {}, ...children) {
    const element = space ? document.createElementNS(space, tag) : document.createElement(tag);
    for (const [name, value] of Object.entries(attributes)) {
      if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
      else if (value !== null && value !== undefined) element.setAttribute(name, value);
    }
    element.append(...children);
    return element;
  }
  const svg = (tag, attributes, ...children) => make(SVG, tag, attributes, ...children);
  const html = (tag, attributes, ...children) => make(null, tag, attributes, ...children);

  /** A number with so many decimals, with a proper minus sign. */
  const fixed = (value, decimals = 2) => {
    const text = value.toFixed(decimals);
    return Number(text) === 0 ? text.replace("-", "") : text.replace("-", "−");
  };

  const clamp = (value, low, high) => Math.min(high, Math.max(low, value));
  const range = (low, high, count) => Array.from({ length: count }, (_, i) => low + ((high - low) * i) / (count - 1));
  const letter = (i) => "ABCDEFGHIJKLMNOPQRSTUVWXYZ"[i % 26];

  // The scene of chapter 6: eight targets (azimuth in rad and range in m), the motion and the noise, as in
  // d2d.study.plane.scenarios; tests/book/test_labs.py compares them.
  const SCENE = {
    polar: [
      [0.2458, 15.5935],
      [0.4928, 21.4556],
      [0.3532, 31.7386],
      [0.077, 23.3288],
      [-0.0364, 32.8625],
      [-0.675, 14.4914],
      [-0.533, 24.3163],
      [-0.3608, 31.1166],
    ],
    theta: [5, 0, (15 * Math.PI) / 180],
    sigmaRange: 0.2,
    sigmaAzimuth: 0.03,
  };
  const SCENE_TARGETS = SCENE.polar.map(([azimuth, range_]) => ({
    x: range_ * Math.cos(azimuth),
    y: range_ * Math.sin(azimuth),
  }));

  /** The thesis's outlier component: a share of outliers, and a standard deviation along both axes (m). */
  const corrupted = (fraction = 0.2, width = 10) => ({ fraction, xx: width ** 2, xy: 0, yy: width ** 2 });

  // ---- Costs and their marks: one look everywhere ------------------------------------------------------------------------

  const COSTS = {
    __proto__: null, // so that `in` finds these names only
    summing: { name: "sum", mark: "square", form: { fusion: "summing" } },
    likelihood: { name: "likelihood", mark: "diamond", form: { fusion: "likelihood" } },
    robust: { name: "robust likelihood", mark: "circle", form: { fusion: "likelihood" } },
  };

  // Targets: those of the sets, and an outlier's ring around one.  As SETS of d2d.study.book.grammar has them.
  const SETS = {
    fixed: { name: "previous scan F", mark: "circle" },
    moving: { name: "current scan M", mark: "peak" },
    outlier: { name: "outlier", mark: "circle" },
  };

  /** The part of a problem that the choice of a cost decides. */
  const formOf = (cost, outlier = corrupted()) => ({
    ...COSTS[cost].form,
    outlier: cost === "robust" ? outlier : null,
  });

  /** A square, diamond, circle, cross or triangle (pointing right, or up: a peak) of about 2 r pixels. */
  function mark(kind, x, y, r, attributes = {}) {
    if (kind === "circle") return svg("circle", { cx: x, cy: y, r, ...attributes });
    const d = {
      square: `M${x - r},${y - r}h${2 * r}v${2 * r}h${-2 * r}z`,
      diamond: `M${x},${y - 1.3 * r}l${1.3 * r},${1.3 * r}l${-1.3 * r},${1.3 * r}l${-1.3 * r},${-1.3 * r}z`,
      cross: `M${x - r},${y}h${2 * r}M${x},${y - r}v${2 * r}`,
      peak: `M${x},${y - 1.2 * r}l${1.1 * r},${2 * r}h${-2.2 * r}z`,
      triangle: `M${x + 1.3 * r},${y}l${-2.1 * r},${r}v${-2 * r}z`,
    }[kind];
    return svg("path", { d, ...attributes });
  }

  /** A target of a set, or an outlier's ring, as something to drag. */
  const targetMark = (set, r = 5.5) => mark(SETS[set].mark, 0, 0, r, { class: `lab-set-${set}` });

  const inline = (drawn) => {
    const picture = svg("svg", { class: "lab-mark", viewBox: "-8 -8 16 16", "aria-hidden": "true" });
    picture.append(drawn);
    return picture;
  };

  /** The mark of a cost in a line of text. */
  const inlineMark = (cost) => inline(mark(COSTS[cost].mark, 0, 0, 5, { class: `lab-fill-${cost}` }));

  /** What a mark means, and what the targets of each set look like. */
  const keyOf = (drawn, meaning) => html("span", {}, inline(drawn), ` ${meaning}`),
    setKey = (...sets) => sets.map((set) => keyOf(targetMark(set), SETS[set].name));

  // ---- Plots ---------------------------------------------------------------------------------------------------------------

  /** About `count` round numbers within a range. */
  function ticks([low, high], count) {
    const raw = (high - low) / count,
      power = 10 ** Math.floor(Math.log10(raw));
    const step = power * [1, 2, 5, 10].find((m) => m * power >= raw);
    const first = Math.ceil(low / step - 1e-9),
      last = Math.floor(high / step + 1e-9);
    return { step, values: Array.from({ length: Math.max(0, last - first + 1) }, (_, i) => (first + i) * step) };
  }

  const MARGIN = { left: 54, right: 10, top: 8, bottom: 38 };
  const BARS = 20; // of a histogram

  /** Axes in an SVG that fills its box. `shape` is height over width, on a phone `narrow`; `equal` makes a metre a metre. */
  class Plot {
    constructor(lab, { label, heat = false, ...options }) {
      Object.assign(this, { lab, ylabel: "", shape: 0.6, equal: false, xTicks: true, yTicks: true, ...options });
      this.narrow ??= this.shape;
      this.box = html("div", { class: "lab-plot" });
      if (heat) this.box.append((this.canvas = html("canvas", { "aria-hidden": "true" })));
      this.svg = svg("svg", { role: "group", "aria-label": label });
      this.axes = svg("g", { class: "lab-axes" });
      this.clip = `${lab.id}-clip-${lab.plots.length}`;
      this.frame = svg("rect");
      this.content = svg("g", { "clip-path": `url(#${this.clip})` });
      this.front = svg("g");
      this.svg.append(svg("clipPath", { id: this.clip }, this.frame), this.axes, this.content, this.front);
      this.box.append(this.svg);
      this.handles = [];
      lab.plots.push(this);
    }

    /** Lay out for the box's present width and draw the axes. */
    extent(x, y) {
      const width = Math.max(120, this.box.clientWidth || 600);
      const height = Math.max(130, Math.round(width * (phone.matches ? this.narrow : this.shape)));
      const left = MARGIN.left,
        top = MARGIN.top,
        w = width - left - MARGIN.right,
        h = height - top - MARGIN.bottom;
      if (this.equal) {
        // widen one axis about its middle
        const scale = Math.max((x[1] - x[0]) / w, (y[1] - y[0]) / h);
        const around = ([low, high], half) => [0.5 * (low + high) - half, 0.5 * (low + high) + half];
        x = around(x, 0.5 * scale * w);
        y = around(y, 0.5 * scale * h);
      }
      const key = [width, height, ...x, ...y].join();
      Object.assign(this, { x, y, left, top, w, h, width, height });
      if (key === this.key) return;
      this.key = key;
      this.svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
      this.svg.style.height = `${height}px`;
      for (const [name, value] of Object.entries({ x: left, y: top, width: w, height: h }))
        this.frame.setAttribute(name, value);
      if (this.canvas) {
        Object.assign(this.canvas.style, {
          left: `${(100 * left) / width}%`,
          top: `${top}px`,
          width: `${(100 * w) / width}%`,
          height: `${h}px`,
        });
      }
      this.axes.replaceChildren(svg("rect", { class: "lab-frame", x: left, y: top, width: w, height: h }));
      const across = ticks(x, clamp(w / 55, 3, 8));
      for (const value of this.xTicks ? across.values : []) {
        const at = this.X(value);
        this.axes.append(
          svg("line", { x1: at, x2: at, y1: top, y2: top + h }),
          svg("text", { x: at, y: top + h + 15, "text-anchor": "middle" }, tickText(value, across.step)),
        );
      }
      const up = ticks(y, clamp(h / 45, 2, 7));
      for (const value of this.yTicks ? up.values : []) {
        const at = this.Y(value);
        this.axes.append(
          svg("line", { x1: left, x2: left + w, y1: at, y2: at }),
          svg("text", { x: left - 6, y: at + 4, "text-anchor": "end" }, tickText(value, up.step)),
        );
      }
      this.axes.append(
        svg("text", { x: left + w / 2, y: height - 5, "text-anchor": "middle" }, this.xlabel),
        svg(
          "text",
          { transform: `translate(${this.yTicks ? 11 : 30} ${top + h / 2}) rotate(-90)`, "text-anchor": "middle" },
          this.ylabel,
        ),
      );
    }

    X(x) {
      return this.left + ((x - this.x[0]) / (this.x[1] - this.x[0])) * this.w;
    }
    Y(y) {
      return this.top + this.h - ((y - this.y[0]) / (this.y[1] - this.y[0])) * this.h;
    }

    /** Where an event is, in the axes' units. */
    at(event) {
      const box = this.svg.getBoundingClientRect();
      const px = ((event.clientX - box.left) / box.width) * this.width,
        py = ((event.clientY - box.top) / box.height) * this.height;
      return [
        this.x[0] + ((px - this.left) / this.w) * (this.x[1] - this.x[0]),
        this.y[0] + ((this.top + this.h - py) / this.h) * (this.y[1] - this.y[0]),
      ];
    }

    /** Forget what was drawn, except for the handles. */
    clear() {
      this.content.replaceChildren();
    }

    add(...elements) {
      this.content.append(...elements);
    }

    line(points, name, attributes = {}) {
      const d = points
        .map(([x, y], i) => `${i ? "L" : "M"}${this.X(x).toFixed(1)},${clamp(this.Y(y), -2000, 4000).toFixed(1)}`)
        .join("");
      this.add(svg("path", { d, class: `lab-line ${name}`, ...attributes }));
    }

    /** A line from one point to another. */
    segment(x1, y1, x2, y2, name) {
      this.line([x1, x2].map((x, i) => [x, [y1, y2][i]]), name);
    }

    /** A line across the whole plot at one x or one y. */
    rule(axis, value, name) {
      if (value < this[axis][0] || value > this[axis][1]) return;
      if (axis === "x") this.segment(value, this.y[0], value, this.y[1], name);
      else this.segment(this.x[0], value, this.x[1], value, name);
    }

    /** The histogram of NEES in n dimensions, whose last bar takes all above it, and the density of chi-square. */
    histogram(nees, n, name) {
      const top = d2d.chiSquareQuantile(0.999, n),
        wide = top / BARS,
        shares = new Array(BARS).fill(0);
      for (const each of nees) shares[Math.min(BARS - 1, Math.floor(each / wide))] += 1 / nees.length;
      this.extent([0, top], [0, 1.25 * Math.max(0.2, ...shares)]); // room for a label above the highest
      this.clear();
      shares.forEach((share, i) => {
        const y = this.Y(share),
          size = { x: this.X(i * wide) + 0.5, width: this.X(wide) - this.X(0) - 1, y, height: this.Y(0) - y };
        this.add(svg("rect", { class: name, "fill-opacity": 0.6, ...size }));
      });
      this.line(
        range(0.02 * top, top, 200).map((x) => [x, wide * d2d.chiSquareDensity(x, n)]),
        "lab-truth",
      );
      this.text(0.99 * top, shares.at(-1), `≥ ${fixed(top - wide, 0)}`, { dy: -5, "text-anchor": "end" });
    }

    mark(kind, x, y, r, name) {
      this.add(mark(kind, this.X(x), this.Y(y), r, { class: name }));
    }

    target(set, x, y, r = 4, name = `lab-set-${set}`) {
      this.mark(SETS[set].mark, x, y, r, name);
    }

    text(x, y, text, attributes = {}) {
      this.add(svg("text", { x: this.X(x), y: this.Y(y), class: "lab-label", ...attributes }, text));
    }

    ellipse(x, y, covariance, sigmas, name) {
      const { major, minor, angle } = d2d.ellipse(covariance, sigmas);
      const sx = this.w / (this.x[1] - this.x[0]),
        sy = this.h / (this.y[1] - this.y[0]);
      const turn = Array.from({ length: 49 }, (_, i) => (2 * Math.PI * i) / 48);
      const points = turn.map((t) => {
        const a = major * Math.cos(t),
          b = minor * Math.sin(t);
        const px = this.X(x) + sx * (a * Math.cos(angle) - b * Math.sin(angle));
        return `${px.toFixed(1)},${(this.Y(y) - sy * (a * Math.sin(angle) + b * Math.cos(angle))).toFixed(1)}`;
      });
      this.add(svg("path", { d: `M${points.join("L")}z`, class: name }));
    }

    /** Paint values over the axes' ranges, the lowest dark. `values` goes row by row from the lower left. */
    paint(values, columns, rows) {
      const low = values.reduce((a, b) => Math.min(a, b), Infinity),
        high = values.reduce((a, b) => Math.max(a, b), -Infinity);
      const image = new ImageData(columns, rows),
        span = Math.max(1e-9, high - low);
      for (let row = 0; row < rows; row++) {
        for (let column = 0; column < columns; column++) {
          const share = ((values[row * columns + column] - low) / span) ** 0.6; // more shades near the bottom
          image.data.set(shade(share), 4 * ((rows - 1 - row) * columns + column));
        }
      }
      this.small ??= document.createElement("canvas");
      Object.assign(this.small, { width: columns, height: rows });
      this.small.getContext("2d").putImageData(image, 0, 0);
      const pixels = Math.min(2, devicePixelRatio || 1);
      Object.assign(this.canvas, { width: Math.round(this.w * pixels), height: Math.round(this.h * pixels) });
      const context = this.canvas.getContext("2d");
      context.imageSmoothingQuality = "high";
      context.drawImage(this.small, 0, 0, this.canvas.width, this.canvas.height);
    }

    /**
     * Something to drag: `get` gives its place, `set(x, y)` moves it; `step` is what an arrow key does, ten times as much
     * with Shift.  `axis: "x"` moves along x only.  `hidden()` takes it away.  Handles of one `scan` are one stop of the
     * Tab key; Page Down and Page Up go from one to the next, because the arrow keys move what is dragged.
     */
    handle({
      name,
      scan = name,
      get,
      set,
      draw,
      step = 0.1,
      axis = "both",
      hidden = () => false,
      say = (x, y) => (axis === "x" ? `${fixed(x)} ${unit}` : `x ${fixed(x)} ${unit}, y ${fixed(y)} ${unit}`),
      unit = "m",
      low = -1e3,
      high = 1e3,
    }) {
      const group = svg("g", { class: "lab-handle", role: "slider", "aria-label": name });
      group.addEventListener("touchstart", (event) => event.preventDefault(), { passive: false }); // WebKit: no touch-action in SVG
      group.addEventListener("focus", () => this.stop(handle));
      group.append(svg("circle", { class: "lab-reach", r: 20 }), ...[].concat(draw));
      const to = (x, y) => {
        set(clamp(x, low, high), axis === "x" ? get()[1] : clamp(y, low, high));
        this.lab.touched();
      };
      let grip = null;
      const grab = (event) => {
        this.lab.touched();
        group.setPointerCapture(event.pointerId);
        const [x, y] = get(),
          [ex, ey] = this.at(event);
        grip = [x - ex, y - ey];
        group.classList.add("lab-held"); // without the rings of a focus by keys
        group.focus({ preventScroll: true });
        event.preventDefault();
      };
      group.addEventListener("pointerdown", (event) => {
        if (!event.button) (this.nearest(event)?.grab ?? grab)(event);
      });
      group.addEventListener("pointermove", (event) => {
        if (!grip) return;
        const [x, y] = this.at(event);
        to(x + grip[0], y + grip[1]);
      });
      for (const end of ["pointerup", "pointercancel"]) group.addEventListener(end, () => (grip = null));
      group.addEventListener("keydown", (event) => {
        group.classList.remove("lab-held");
        const pages = { PageUp: -1, PageDown: 1 }[event.key],
          peers = this.peers(handle);
        if (pages && peers.length > 1) {
          peers.at((peers.indexOf(handle) + pages) % peers.length).group.focus({ preventScroll: true });
          event.preventDefault();
        }
        const by = {
          ArrowLeft: [-1, 0],
          ArrowRight: [1, 0],
          ArrowUp: axis === "x" ? [1, 0] : [0, 1],
          ArrowDown: axis === "x" ? [-1, 0] : [0, -1],
        }[event.key];
        if (!by) return;
        const [x, y] = get(),
          size = step * (event.shiftKey ? 10 : 1);
        to(x + size * by[0], y + size * by[1]);
        event.preventDefault();
      });
      const handle = {
        group,
        grab,
        scan,
        place: () => {
          const gone = hidden();
          group.style.display = gone ? "none" : "";
          if (gone) return;
          const [x, y] = get();
          group.setAttribute("transform", `translate(${this.X(x).toFixed(1)} ${this.Y(y).toFixed(1)})`);
          const values = { now: x.toFixed(2), min: low, max: high, text: say(x, y) };
          for (const [key, value] of Object.entries(values)) group.setAttribute(`aria-value${key}`, value);
        },
      };
      this.handles.push(handle);
      this.front.append(group);
    }

    /** Of the handles whose reach an event is in, the nearest: reaches overlap, and the last drawn would win. */
    nearest({ clientX, clientY }) {
      const away = ({ group }) => {
        const box = group.firstChild.getBoundingClientRect();
        if (!box.width) return Infinity; // hidden
        return Math.hypot(box.x + box.width / 2 - clientX, box.y + box.height / 2 - clientY) / (box.width / 2);
      };
      return this.handles.filter((each) => away(each) <= 1).sort((a, b) => away(a) - away(b))[0];
    }

    /** The handles that are seen of a handle's scan. */
    peers({ scan }) {
      return this.handles.filter((each) => each.scan === scan && each.group.style.display !== "none");
    }

    /** Let the Tab key stop at this handle of its scan only. */
    stop(handle) {
      for (const each of this.peers(handle)) each.group.setAttribute("tabindex", each === handle ? "0" : "-1");
    }

    place() {
      this.handles.forEach((handle) => handle.place());
      for (const handle of this.handles) {
        const peers = this.peers(handle);
        if (peers.length && !peers.some((each) => each.group.tabIndex === 0)) this.stop(peers[0]);
      }
    }
  }

  const tickText = (value, step) => fixed(value, Math.max(0, -Math.floor(Math.log10(step) + 1e-9)));

  // Viridis, as the printed maps have it: what is low is dark, in both themes.
  const RAMP = [
    [68, 1, 84],
    [65, 68, 135],
    [42, 120, 142],
    [34, 168, 132],
    [122, 209, 81],
    [253, 231, 37],
  ];
  function shade(share) {
    const banded = Math.round(clamp(share, 0, 1) * 40) / 40;
    const place = banded * (RAMP.length - 1),
      i = Math.min(RAMP.length - 2, Math.floor(place)),
      part = place - i;
    return [...RAMP[i].map((value, c) => value + part * (RAMP[i + 1][c] - value)), 255];
  }

  // ---- A laboratory ----------------------------------------------------------------------------------------------------------

  /** What a module is given: the element, the state, and makers of plots and controls. */
  class Lab {
    constructor(element, defaults) {
      this.element = element;
      this.id = element.id;
      this.defaults = defaults;
      this.state = structuredClone(defaults);
      this.plots = [];
      this.controls = [];
      this.spoken = html("p", { class: "visually-hidden", "aria-live": "polite" });
      this.words = html("div", {});
      this.numbers = fold("Numbers"); // open where there is room
      this.numbers.classList.add("lab-numbers");
      this.told = html("div", { class: "lab-told" }, this.words);
      const unfold = () => (this.numbers.open = !phone.matches);
      phone.addEventListener("change", unfold);
      unfold();
    }

    plot(options) {
      return new Plot(this, options);
    }

    /** A native slider for a number of the state, shown while `when()`. */
    slider(key, { label, min, max, step, show = (v) => `${v}`, when = () => true }) {
      const input = html("input", { type: "range", min, max, step, id: `${this.id}-${key}` });
      const output = html("output", { for: input.id });
      input.addEventListener("input", () => {
        this.state[key] = Number(input.value);
        this.touched(key);
      });
      this.controls.push(() => {
        input.value = this.state[key];
        output.textContent = show(this.state[key]);
        input.setAttribute("aria-valuetext", output.textContent);
      });
      const row = html("div", { class: "lab-control" }, html("label", { for: input.id }, label), input, output);
      this.controls.push(() => (row.hidden = !when()));
      return row;
    }

    /** Radio buttons for a string of the state. */
    choice(key, legend, options) {
      const inputs = Object.entries(options).map(([value, content]) => {
        const input = html("input", { type: "radio", name: `${this.id}-${key}`, value });
        input.addEventListener("change", () => {
          this.state[key] = value;
          this.touched(key);
        });
        return [input, html("label", {}, input, ...[].concat(content))];
      });
      this.controls.push(() => inputs.forEach(([input]) => (input.checked = input.value === this.state[key])));
      return html("fieldset", { class: "lab-choice" }, html("legend", {}, legend), ...inputs.map(([, label]) => label));
    }

    costs() {
      const options = Object.entries(COSTS).map(([name, cost]) => [name, [inlineMark(name), ` ${cost.name}`]]);
      const row = this.choice("cost", "Cost", Object.fromEntries(options));
      row.classList.add("lab-costs");
      return row;
    }

    /** A checkbox for a 0 or 1 of the state. */
    check(key, label) {
      const input = html("input", { type: "checkbox" });
      input.addEventListener("change", () => {
        this.state[key] = input.checked ? 1 : 0;
        this.touched(key);
      });
      this.controls.push(() => (input.checked = Boolean(this.state[key])));
      return html("label", { class: "lab-check" }, input, ` ${label}`);
    }

    button(label, act) {
      return html("button", { type: "button", class: "lab-button", onclick: () => act() }, label);
    }

    /** A button that goes to the next of what a number of the state counts, such as draws. */
    next(label, key, prepare = () => {}) {
      return this.button(label, () => {
        this.state[key] += 1;
        prepare();
        this.touched(key);
      });
    }

    /** Sliders for the outlier component, shown while the cost has one. */
    outlierSliders() {
      const when = () => this.state.cost === "robust",
        share = { label: "share of outliers α", min: 0.001, max: 0.9, step: 0.001, show: (v) => fixed(v, 3) },
        width = { label: "their width σₒ", min: 0.3, max: 30, step: 0.1, show: (v) => `${fixed(v, 1)} m` };
      return [this.slider("alpha", { ...share, when }), this.slider("width", { ...width, when })];
    }

    /** What every laboratory ends with: back to the first view, on to others, and to one's own computations. */
    tools() {
      const reset = this.button("Start over", () => this.startOver());
      const copy = this.button("Copy link", async () => {
        const link = location.href.split("#")[0] + this.address();
        try {
          await navigator.clipboard.writeText(link);
          copy.textContent = "Link copied";
          setTimeout(() => (copy.textContent = "Copy link"), 1500);
        } catch {
          prompt("The link to this view", link); // a page that may not use the clipboard
        }
      });
      const tools = html("span", { class: "lab-tools" }, reset, copy, ...(this.python ? [this.script()] : [])),
        more = this.button("⋯", () => (more.ariaExpanded = more.ariaExpanded !== "true"));
      more.classList.add("lab-more"); // on a phone
      Object.assign(more, { ariaExpanded: "false", ariaLabel: "More" });
      return [more, tools];
    }

    /** The lines of Python that give the numbers on the screen. */
    script() {
      const code = html("pre", { class: "lab-command", tabindex: "0" }),
        opened = fold("Show as Python", code);
      opened.addEventListener("toggle", () => (opened.open && this.begin(), this.update()));
      this.controls.push(() => {
        if (opened.open) code.textContent = this.python();
      });
      return opened;
    }

    /** Scroll to the laboratory, out of what it is folded in, as far as it is not in view. */
    show() {
      const fold = this.element.closest("details");
      if (fold) fold.open = true;
      this.element.scrollIntoView({ block: this.element.offsetHeight < innerHeight ? "nearest" : "start" });
    }

    startOver() {
      Object.assign(this.state, structuredClone(this.defaults));
      this.touched("reset");
    }

    /** Tell what comes out, which waits for a guess or for something moved. */
    begin() {
      this.element.classList.remove("lab-waits");
    }

    /** Put the parts on the page in place of the printed fallback. */
    build(parts, draw) {
      this.drawing = draw;
      const printed = html("div", { class: "lab-printed" }, ...this.element.childNodes),
        picture = parts.findLastIndex((part) => part.matches(".lab-plot") || part.querySelector(".lab-plot"));
      if (!parts.includes(this.told)) parts.splice(picture < 0 ? parts.length : picture + 1, 0, this.told);
      parts.push(this.numbers, ...stepper(this)); // what grows stands below the controls
      this.element.replaceChildren(html("div", { class: "lab-main" }, ...parts), this.spoken, printed);
      this.element.classList.add("lab-live");
      addEventListener("hashchange", () => {
        if (!this.read()) return;
        this.begin();
        this.stop();
        this.changed?.("address");
        this.update();
        this.show();
      });
      const shown = this.read();
      if (shown) (this.begin(), this.changed?.("address"));
      this.draw();
      let width = this.element.clientWidth;
      new ResizeObserver(() => {
        if (this.element.clientWidth === width) return;
        width = this.element.clientWidth;
        this.words.style.minHeight = "";
        this.update();
      }).observe(this.element);
      if (shown) this.show();
      all[this.id] = this;
    }

    /** After a change by hand: end an animation, draw, and write the state to the address. */
    touched(key) {
      this.begin();
      this.stop();
      this.changed?.(key);
      this.update();
      clearTimeout(this.writing);
      this.writing = setTimeout(() => this.write(), 400);
    }

    update() {
      this.waiting ??= requestAnimationFrame(() => {
        this.waiting = null;
        this.draw();
      });
    }

    draw() {
      const began = performance.now();
      this.controls.forEach((refresh) => refresh());
      this.drawing();
      this.plots.forEach((plot) => plot.place());
      this.words.style.minHeight = `${this.words.offsetHeight}px`; // fewer words do not move what is below
      this.took = performance.now() - began;
    }

    /** Show a result, which screen readers announce once the input pauses, and the numbers behind it. */
    tell(words, ...numbers) {
      this.words.replaceChildren(...[].concat(words));
      this.numbers.replaceChildren(this.numbers.firstChild, ...numbers);
      this.numbers.hidden = !numbers.length;
      clearTimeout(this.speaking);
      this.speaking = setTimeout(() => (this.spoken.textContent = this.words.innerText), 700);
    }

    /** A table of numbers: the first cell of each row is its heading. */
    table(head, rows) {
      const row = (cells, tag) =>
        html(
          "tr",
          {},
          ...cells.map((cell, i) =>
            html(
              i ? tag : "th",
              { scope: i && tag === "td" ? null : tag === "th" ? "col" : "row" },
              ...[].concat(cell),
            ),
          ),
        );
      return html(
        "div",
        { class: "lab-table" },
        html(
          "table",
          {},
          html("thead", {}, row(head, "th")),
          html("tbody", {}, ...rows.map((cells) => row(cells, "td"))),
        ),
      );
    }

    /** Call `frame(share)` with shares from 0 to 1; at once with 1 if reduced motion is preferred. */
    animate(seconds, frame, done = () => {}) {
      this.stop();
      if (still.matches) {
        frame(1);
        done();
        return;
      }
      const began = performance.now();
      const next = (now) => {
        const share = clamp((now - began) / (1000 * seconds), 0, 1);
        frame(share);
        if (share < 1) this.running = requestAnimationFrame(next);
        else done();
      };
      this.running = requestAnimationFrame(next);
    }

    /** Animate along the points of a path: `frame` gets each point between them, and how many are behind it. */
    follow(path, seconds, frame, done) {
      this.animate(
        Math.min(seconds, 0.3 * path.length),
        (share) => {
          const at = share * (path.length - 1),
            i = Math.floor(at),
            next = path[Math.min(i + 1, path.length - 1)];
          const between = path[i].map((value, j) => value + (at - i) * (next[j] - value));
          frame(between, i);
          this.update();
        },
        done,
      );
    }

    stop() {
      cancelAnimationFrame(this.running);
    }

    // The address holds what differs from the first view: #lab-line?cost=robust&fixed=0,8,10.2
    address() {
      const parts = Object.entries(this.state)
        .filter(([key, value]) => JSON.stringify(value) !== JSON.stringify(this.defaults[key]))
        .map(
          ([key, value]) =>
            `${key}=${[]
              .concat(value)
              .map((v) => (typeof v === "number" ? Number(v.toPrecision(7)) : v))
              .join(",")}`,
        );
      return `#${this.id}${parts.length ? `?${parts.join("&")}` : ""}`;
    }

    write() {
      try {
        history.replaceState(history.state, "", this.address());
      } catch {
        /* a browser that allows no history for files: the view is then not in the address */
      }
    }

    /** Take the state from the address; whether it names this laboratory. Invalid values are ignored. */
    read() {
      let hash = "";
      try {
        hash = decodeURIComponent(location.hash.slice(1));
      } catch {
        /* an address with a stray percent sign names no laboratory */
      }
      const [id, query = ""] = hash.split("?");
      if (id !== this.id || !query) return id === this.id;
      const state = structuredClone(this.defaults);
      for (const part of query.split("&")) {
        const [key, text = ""] = part.split("=");
        if (!Object.hasOwn(state, key)) continue;
        const own = state[key],
          numbers = text.split(",").map(Number),
          sound = text !== "" && numbers.every((n) => Math.abs(n) <= 1e6);
        if (typeof own === "string") state[key] = /^[a-z]+$/.test(text) ? text : own;
        else if (sound && Array.isArray(own)) state[key] = numbers.length <= 200 ? numbers : own;
        else if (sound) state[key] = numbers[0];
      }
      this.state = this.sound?.(state) === false ? structuredClone(this.defaults) : state;
      return true;
    }
  }

  // ---- The same in Python ----------------------------------------------------------------------------------------------------

  const NAMES = {
    d2d: ["ANNEALED", "CorruptedGaussian", "PointSet", "RegistrationCost", "credibility", "multi_start", "register"],
    "d2d.radar": ["Mounting", "RadarScan", "estimate_ego_motion"],
  };

  /** A script from its lines, with the imports that they need. */
  function script(...lines) {
    const body = lines.join("\n"),
      imports = Object.entries(NAMES)
        .map(([module, names]) => [module, names.filter((name) => body.includes(name))])
        .filter(([, names]) => names.length)
        .map(([module, names]) => `from ${module} import ${names.join(", ")}\n`);
    return `import numpy as np\n${imports.join("")}\n${body}\n`;
  }

  /** A number, and a list of them, in digits enough for what is shown of the result. */
  const short = (value) => Number(value.toPrecision(8));
  const list = (values) => `[${values.map(short).join(", ")}]`;

  /** The cost of a problem. */
  function costOf({ fusion, outlier, line }) {
    if (fusion === "summing") return 'RegistrationCost(fusion="summing")';
    if (!outlier) return "RegistrationCost()";
    const variance = `${short(outlier.xx)} * np.eye(${line ? 1 : 2})`;
    return `RegistrationCost(outlier=CorruptedGaussian(${outlier.fraction}, ${variance}))`;
  }

  /** Targets in a sensor's frame, given by range and azimuth and their standard deviations. */
  function polarSet(targets, ...sigmas) {
    const ranges = list(targets.map(({ x, y }) => Math.hypot(x, y))),
      azimuths = list(targets.map(({ x, y }) => Math.atan2(y, x)));
    return `PointSet.from_polar(\n    ${ranges},\n    ${azimuths},\n    ${sigmas.join(", ")},\n)`;
  }

  /** How far an optimum is from the true motion, and what its covariance says of that. */
  function verdict({ theta, covariance }, truth) {
    const off = theta.map((each, i) => each - truth[i]),
      inside = covariance && d2d.nees(off, covariance) < 14.156; // 99.73 % of chi-square with 3 degrees of freedom
    return [
      html("strong", {}, `${fixed(Math.hypot(off[0], off[1]))} m and ${fixed(Math.abs(off[2] * 180) / Math.PI, 1)}°`),
      " off the truth. ",
      covariance ? "The 99.7\u00a0% ellipsoid of its covariance, in x, y and rotation, " : "Its covariance is not defined.",
      !covariance ? "" : inside ? "holds such an error." : "says that such an error is next to impossible.",
    ];
  }

  /** A question to answer before the laboratory: its list becomes buttons, and what follows shows once one is pressed. */
  function ask(question) {
    const list = question.querySelector("ul"),
      reveal = html("div", { "aria-live": "polite", hidden: "" });
    while (list.nextElementSibling) reveal.append(list.nextElementSibling);
    const answers = [...list.children].map((item) => {
      const right = Boolean(item.querySelector("strong"));
      const choose = () => {
        answers.forEach((each) => each.setAttribute("aria-pressed", each === button));
        verdict.textContent = right ? "Right. " : "No. ";
        reveal.hidden = false;
      };
      const look = { type: "button", class: "lab-button", "aria-pressed": "false", onclick: choose },
        button = html("button", look, item.textContent.trim());
      return button;
    });
    const verdict = html("strong", {});
    reveal.firstElementChild.prepend(verdict);
    list.replaceWith(bar(...answers), reveal);
  }

  /**
   * The guess and the steps around a laboratory, moved into its frame and shown one at a time, each with what is seen in it.
   * Returns the elements to add: none where the text has no steps.
   */
  function stepper(lab) {
    const { element } = lab,
      before = [element.previousElementSibling, element.previousElementSibling?.previousElementSibling],
      [guess, list] = [".lab-guess", "ol"].map((kind) => before.find((each) => each?.matches(kind))),
      fold = element.nextElementSibling?.matches("details.sd-dropdown") ? element.nextElementSibling : null,
      seen = [...(fold?.querySelectorAll("ol > li") ?? [])],
      steps = [...(list?.children ?? [])];
    if (!guess && !steps.length) return [];
    const pages = steps.map((step, i) => {
      const answer = seen[i] && html("details", {}, html("summary", {}, "What you should have seen"), ...seen[i].childNodes);
      return [`Step ${i + 1} of ${steps.length}`, html("div", { class: "lab-leaf" }, ...step.childNodes, ...(answer ? [answer] : []))];
    });
    if (guess) {
      pages.unshift(["Guess first", html("div", { class: "lab-leaf" }, guess)]);
      element.classList.add("lab-waits");
      guess.addEventListener("click", ({ target }) => target.matches("button") && lab.begin());
    }
    list?.remove();
    if (seen.length) fold.remove();
    let shown = 0;
    const title = html("strong", { "aria-live": "polite" });
    const go = (by) => {
      if (guess && shown === 0 && by > 0) lab.startOver(); // the first step finds what it describes, not what was seen
      shown = clamp(shown + by, 0, pages.length - 1);
      title.textContent = pages[shown][0];
      pages.forEach(([, page], i) => (page.hidden = i !== shown));
      [back, on].forEach((button, i) => (button.disabled = shown === [0, pages.length - 1][i]));
    };
    const turn = (sign, label, by) =>
      html("button", { type: "button", class: "lab-button", "aria-label": label, onclick: () => go(by) }, sign);
    const back = turn("‹", "Previous step", -1),
      on = turn("›", "Next step", 1);
    go(0);
    const head = pages.length > 1 ? [back, title, on] : [title];
    return [html("section", { class: "lab-steps", "aria-label": "Steps" }, bar(...head), ...pages.map(([, page]) => page))];
  }

  /** A row of controls, one of pictures side by side, and a line that says what their marks mean. */
  const bar = (...parts) => html("div", { class: "lab-bar" }, ...parts),
    row = (...parts) => html("div", { class: "lab-row" }, ...parts),
    extra = (...parts) => html("div", { class: "lab-bar lab-extra" }, ...parts), // on a phone behind the button ⋯
    legend = (...parts) => html("p", { class: "lab-key" }, ...parts);

  /** What is opened by a press. */
  const fold = (title, ...content) =>
    html("details", { class: "lab-fold" }, html("summary", { class: "lab-button" }, title), ...content);

  /** The part of a covariance matrix in the plane, as the engine has it. */
  const planar = ([[xx, xy], [, yy]]) => ({ xx, xy, yy });

  /** A plot under a title. */
  const panel = (title, plot) => html("div", {}, html("p", { class: "lab-title" }, title), plot.box);

  /** Set up every laboratory of this name on the page; `setup(lab)` builds it. */
  function define(name, defaults, setup) {
    const begin = () =>
      document.querySelectorAll(`.lab[data-lab="${name}"]`).forEach((element, i) => {
        element.id ||= `lab-${name}${i || ""}`;
        setup(new Lab(element, defaults(element.dataset)));
      });
    if (document.readyState === "loading") addEventListener("DOMContentLoaded", begin);
    else begin();
  }

  document.querySelectorAll(".lab-guess").forEach(ask);
  // as wide as the page: the theme then folds its contents, which stand there
  document.querySelectorAll(".lab").forEach((each) => each.classList.toggle("full-width", !each.closest("details")));

  return {
    define,
    all,
    svg,
    html,
    mark,
    inlineMark,
    targetMark,
    keyOf,
    setKey,
    fixed,
    clamp,
    range,
    letter,
    verdict,
    bar,
    row,
    extra,
    legend,
    fold,
    panel,
    planar,
    corrupted,
    formOf,
    script,
    list,
    short,
    costOf,
    polarSet,
    COSTS,
    SETS,
    SCENE,
    SCENE_TARGETS,
  };
})();
