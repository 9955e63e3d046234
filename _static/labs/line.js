// The line laboratory: targets on a line that can be dragged, the cost over the translation, and a ball that rolls on it.
labs.define(
  "line",
  (data) => ({
    fixed: [0.05, 8.12, 10.25], // m, observed: the draw of the printed figures
    moving: [-2.2, 6.14, 8.27],
    outlier: data.outlier ? 1 : 0, // whether M has the target O, without a partner
    o: 3.92,
    t: data.outlier ? 6 : 6.4, // m, where the ball is
    cost: data.outlier ? "likelihood" : "summing",
    view: "log",
    noise: 0.15, // m
    alpha: 0.2,
    width: 10, // m
    draw: 0,
  }),
  (lab) => {
    const { svg, html, targetMark, fixed: number, range, bar, formOf, corrupted, COSTS } = labs;
    const ROW = 1.35; // where F is drawn; M is at 0
    const TRUTH = 2,
      TRUE = [0, 8, 10.2],
      NAMES = ["B", "A", "C", "O"];
    const T = range(-12, 16, 1121);
    lab.sound = (state) =>
      state.fixed.length === 3 &&
      state.moving.length === 3 &&
      state.cost in COSTS &&
      Math.abs(state.t - 2) <= 14 &&
      state.noise > 0 &&
      state.width > 0;

    const sets = lab.plot({
      label: "The targets of both scans",
      xlabel: "x (m)",
      ylabel: "",
      shape: 0.24,
      narrow: 0.36,
      yTicks: false,
    });
    const curve = lab.plot({
      label: "The cost over the translation",
      xlabel: "translation tₓ (m)",
      shape: 0.31,
      narrow: 0.55,
    });
    let result = null,
      trail = [];

    const moving = () => [...lab.state.moving, ...(lab.state.outlier ? [lab.state.o] : [])];

    /** The problem as the engine reads it. */
    function problem(cost = lab.state.cost, targets = moving()) {
      const target = (x) => ({ x, y: 0, xx: lab.state.noise ** 2, xy: 0, yy: 0 });
      const form = formOf(cost, corrupted(lab.state.alpha, lab.state.width));
      return { fixed: lab.state.fixed.map(target), moving: targets.map(target), line: true, ...form };
    }

    /** Log densities over T: of every target, and of all together. */
    function surfaces() {
      const { cost } = lab.state;
      const each = moving().map((x) =>
        d2d.surface({ ...problem(cost, [x]), fusion: "likelihood" }, T, [0], 0).map((v) => -v),
      );
      const all = d2d.surface(problem(), T, [0], 0).map((v) => -v);
      return { each, all };
    }

    const maxima = (values) =>
      T.map((t, i) => i).filter(
        (i) => i > 0 && i < T.length - 1 && values[i] > values[i - 1] && values[i] >= values[i + 1],
      );

    // ---- The two scans ------------------------------------------------------------------------------------------------------

    const letterAt = (name, ...marks) => [...marks, svg("text", { y: 21, "text-anchor": "middle" }, name)];
    for (let i = 0; i < 3; i++) {
      sets.handle({
        name: `Target ${NAMES[i]} of the previous scan F`,
        scan: "F",
        axis: "x",
        step: 0.05,
        low: -16,
        high: 20,
        draw: letterAt(NAMES[i], targetMark("fixed")),
        get: () => [lab.state.fixed[i], ROW],
        set: (x) => {
          lab.state.fixed[i] = x;
          trail = [];
        },
      });
    }
    for (let k = 0; k < 4; k++) {
      sets.handle({
        name: `Target ${NAMES[k]} of the current scan M, where the translation puts it`,
        scan: "M",
        axis: "x",
        step: 0.05,
        low: -30,
        high: 34,
        draw: letterAt(NAMES[k], targetMark("moving"), ...(k === 3 ? [targetMark("outlier", 11)] : [])),
        hidden: () => k === 3 && !lab.state.outlier,
        get: () => [moving()[k] + lab.state.t, 0],
        set: (x) => {
          if (k < 3) lab.state.moving[k] = x - lab.state.t;
          else lab.state.o = x - lab.state.t;
          trail = [];
        },
      });
    }

    function drawSets() {
      const { state } = lab,
        x = range(-8, 20, 561);
      sets.extent([-8, 20], [-0.8, 2.3]);
      sets.clear();
      const bell = (mean, floor, name) =>
        sets.line(
          x
            .filter((at) => Math.abs(at - mean) < 5 * state.noise)
            .map((at) => [at, floor + 0.55 * Math.exp(-0.5 * ((at - mean) / state.noise) ** 2)]),
          name,
        );
      state.fixed.forEach((mean) => bell(mean, ROW, ""));
      moving().forEach((mean) => bell(mean + state.t, 0, "lab-moving"));
      sets.rule("y", ROW, "lab-line");
      sets.rule("y", 0, "lab-line");
      sets.text(-7.8, 1.92, "previous scan F");
      sets.text(-7.8, 0.4, sets.w > 400 ? "current scan M, moved by tₓ" : "M + tₓ");
    }

    // ---- The cost over the translation ----------------------------------------------------------------------------------------

    const value = (log, top) => (lab.state.view === "log" ? -log : Math.exp(log - top));
    let shown = null;
    curve.handle({
      name: "Translation, the ball",
      axis: "x",
      step: 0.05,
      low: -12,
      high: 16,
      draw: svg("circle", { class: "lab-knob lab-ball", r: 8 }),
      get: () => [lab.state.t, shown ? height(lab.state.t) : 0],
      set: (x) => {
        lab.state.t = x;
        trail = [];
      },
    });

    /** The height of the curve at a translation. */
    const height = (t) => value(-d2d.evaluate(problem(), [t, 0, 0]).value, shown.top);

    function drawCurve() {
      const { state } = lab,
        { each, all } = surfaces();
      const top = Math.max(...all),
        log = state.view === "log";
      shown = { top };
      const costs = all.map((v) => value(v, top));
      const high = Math.max(...costs);
      // in the logarithm a product's walls are hundreds high: what is told apart is near the bottom, but for the ball
      const low = Math.min(...costs, ...(log ? [] : [0]));
      const span = log ? Math.max(Math.min(high - low, 160), height(state.t) - low) : 1;
      curve.ylabel = log ? "−log density" : "density, highest = 1";
      curve.key = null;
      curve.extent([-12, 16], log ? [low - 0.08 * span, low + 1.08 * span] : [-0.04, 1.08]);
      curve.clear();
      each.forEach((logs, k) => {
        const own = Math.max(...logs);
        curve.line(
          T.map((t, i) => [t, log ? low - logs[i] + own : Math.exp(logs[i] - own)]),
          "lab-line",
          { "stroke-opacity": 0.45, "data-target": NAMES[k] },
        );
      });
      curve.rule("x", TRUTH, "lab-truth");
      curve.line(
        T.map((t, i) => [t, costs[i]]),
        `lab-${state.cost} lab-strong`,
      );
      trail.forEach((t) => curve.mark(COSTS[state.cost].mark, t, height(t), 3.5, `lab-fill-${state.cost}`));
      return { peaks: maxima(all), all };
    }

    /** How much each target says of the present translation, and where the valleys are. */
    function tell({ peaks, all }) {
      const { state } = lab;
      const best = peaks.reduce((a, b) => (all[a] >= all[b] ? a : b), peaks[0] ?? 0);
      const here = d2d.evaluate({ ...problem(), fusion: "likelihood" }, [state.t, 0, 0]);
      const factors = [["its density there (1/m)", ...here.logs.map((log) => (log === -Infinity ? "0" : short(log)))]];
      if (state.cost === "robust")
        factors.push(["is an inlier", ...here.shares.map((share) => `${Math.round(100 * share)} %`)]);
      result = { problem: problem(), minima: peaks.length, lowest: d2d.register(problem(), [T[best], 0, 0]).theta[0] };
      lab.result = result;
      const p = html("p", {});
      p.append(
        labs.inlineMark(state.cost),
        ` ${COSTS[state.cost].name}: `,
        html("strong", {}, `${result.minima} ${result.minima === 1 ? "valley" : "valleys"}`),
        `, the deepest at ${number(result.lowest)} m (the targets moved by ${TRUTH} m). The ball is at ${number(state.t)} m.`,
      );
      lab.tell(p, lab.table(["target", ...NAMES.slice(0, here.logs.length)], factors));
    }

    const spoken = (words) => html("span", { class: "visually-hidden" }, ` ${words} `);
    /** A density from its logarithm: 0.42, or a power of ten. */
    function short(log) {
      const ten = log / Math.LN10;
      return ten > -2 ? number(Math.exp(log), 3) : html("span", {}, "10", spoken("to the"), html("sup", {}, number(ten, 0)));
    }

    function roll() {
      const { path } = d2d.register(problem(), [lab.state.t, 0, 0]);
      trail = path.map(([t]) => t);
      lab.follow(
        path,
        2,
        ([t]) => (lab.state.t = t),
        () => lab.touched(),
      );
    }

    function draw() {
      const noise = d2d.normals(lab.state.draw),
        observe = (true_) => Number((true_ + lab.state.noise * noise()).toFixed(2));
      lab.state.fixed = TRUE.map(observe);
      lab.state.moving = TRUE.map((x) => observe(x - TRUTH));
      trail = [];
    }

    lab.changed = (key) => {
      if (key !== undefined) trail = [];
    };

    lab.python = () => {
      const { fixed, noise } = lab.state;
      const set = (xs) => `PointSet(np.c_[${labs.list(xs)}], ${number(noise)}**2 * np.ones((${xs.length}, 1, 1)))`;
      return labs.script(
        `previous = ${set(fixed)}`,
        `current = ${set(moving())}`,
        `cost = ${labs.costOf(problem())}`,
        `deepest = multi_start(previous, current, cost, np.c_[np.linspace(-12, 16, 225)])`,
        'print(f"the deepest valley is at {deepest.theta[0]:.2f} m")',
        `ball = register(previous, current, cost, initial=${labs.list([lab.state.t])})`,
        'print(f"the ball rolls to {ball.theta[0]:.2f} m")',
      );
    };

    lab.build(
      [
        bar(lab.costs(), lab.choice("view", "Show", { log: "−log density", density: "density" })),
        sets.box,
        curve.box,
        bar(
          lab.button("Let the ball roll", roll),
          lab.next("Next draw", "draw", draw),
          lab.check("outlier", "outlier O"),
          ...lab.tools(),
        ),
        bar(
          lab.slider("t", { label: "translation tₓ", min: -12, max: 16, step: 0.01, show: (v) => `${number(v)} m` }),
          lab.slider("noise", { label: "σ of a target", min: 0.05, max: 1, step: 0.01, show: (v) => `${number(v)} m` }),
        ),
        labs.extra(...lab.outlierSliders()),
      ],
      () => {
        drawSets();
        tell(drawCurve());
      },
    );
  },
);
