// The plane laboratory: two scans whose targets can be dragged, the cost over the translation, and the descent from a start
// that can be dragged to an optimum with its covariance.
labs.define(
  "plane",
  () => ({
    // m, each scan in its own frame, x and y of each target in turn: the draw of the printed figures
    fixed: [
      15.15, 3.98, 18.96, 10.4, 29.83, 11.03, 22.97, 2.15, 32.99, -1.93, 11.34, -9.17, 20.67, -12.6, 29.42, -10.5,
    ],
    moving: [
      10.82, 0.17, 16.33, 5.27, 26.64, 4.03, 18.01, -3.21, 26.64, -8.19, 3.8, -10.3, 13.37, -15.45, 20.03, -17.66,
    ],
    x: -5, // of the start, relative to the true motion: m, m, deg
    y: 3,
    turn: 0,
    cost: "likelihood",
    alpha: 0.2,
    width: 10, // m
    inflate: 1,
    basin: 0, // whether the starts that arrive are painted
    anneal: 0, // whether the descent steps the standard deviations down
    draw: 0,
  }),
  (lab) => {
    const { svg, html, targetMark, fixed: number, range, letter, bar, panel, formOf, corrupted, COSTS, SCENE } = labs;
    const TRUTH = SCENE.theta,
      DEGREE = Math.PI / 180,
      REACH = 10;
    const { sigmaRange: SIGMA_RANGE, sigmaAzimuth: SIGMA_AZIMUTH } = SCENE,
      SQUARE = { shape: 0.82, narrow: 1, equal: true }, // of both pictures
      STREET = { step: 0.2, low: -40, high: 70 }, // m, where targets can be
      MOST = 20; // targets of a scan
    const TRUE = labs.SCENE_TARGETS;
    const sized = (list) => list.length >= 6 && list.length <= 2 * MOST && list.length % 2 === 0;
    lab.sound = (state) =>
      sized(state.fixed) && sized(state.moving) && state.cost in COSTS && state.inflate > 0 && state.width > 0;

    const scene = lab.plot({
      label: "Both scans",
      xlabel: "x (m)",
      ylabel: "y (m)",
      ...SQUARE,
    });
    const map = lab.plot({
      label: "The cost over the translation",
      xlabel: "off in x (m)",
      ylabel: "off in y (m)",
      ...SQUARE,
      heat: true,
    });

    const counts = (list) => range(0, list.length / 2 - 1, list.length / 2);
    const point = (list, i) => ({ x: list[2 * i], y: list[2 * i + 1] });
    const setPoint = (list, i, p) => list.splice(2 * i, 2, p.x, p.y);
    const measured = (p) => d2d.fromPolar(Math.hypot(p.x, p.y), Math.atan2(p.y, p.x), SIGMA_RANGE, SIGMA_AZIMUTH);
    const targets = (list) => counts(list).map((i) => measured(point(list, i)));
    const start = () => [TRUTH[0] + lab.state.x, TRUTH[1] + lab.state.y, TRUTH[2] + lab.state.turn * DEGREE];

    function problem(cost = lab.state.cost) {
      const { fixed, moving, alpha, width, inflate } = lab.state;
      const plain = { fixed: targets(fixed), moving: targets(moving), ...formOf(cost, corrupted(alpha, width)) };
      return inflate === 1 ? plain : d2d.inflated(plain, inflate);
    }

    // ---- The scene -------------------------------------------------------------------------------------------------------------

    const home = d2d.inverseMotion(TRUTH);
    for (let i = 0; i < MOST; i++) {
      scene.handle({
        name: `Target ${letter(i)} of the previous scan F`,
        scan: "F",
        ...STREET,
        draw: targetMark("fixed"),
        hidden: () => 2 * i >= lab.state.fixed.length,
        get: () => lab.state.fixed.slice(2 * i, 2 * i + 2),
        set: (x, y) => setPoint(lab.state.fixed, i, { x, y }),
      });
    }
    const marks = range(0, MOST - 1, MOST).map((i) => {
      const knob = targetMark("moving", 6);
      scene.handle({
        name: `Target ${letter(i)} of the current scan M, at the true motion`,
        scan: "M",
        ...STREET,
        draw: [knob, svg("text", { x: 9, y: -7 }, letter(i))],
        hidden: () => 2 * i >= lab.state.moving.length,
        get: () => {
          const p = d2d.move(point(lab.state.moving, i), TRUTH);
          return [p.x, p.y];
        },
        set: (x, y) => setPoint(lab.state.moving, i, d2d.move({ x, y }, home)),
      });
      return knob;
    });

    let watched = false, // the descent is drawn once it was watched, or something moved
      walked = null; // while it is watched: its steps so far, and the motion at which M is drawn
    function drawScene(found) {
      scene.extent([-3, 38], [-19, 20]);
      scene.clear();
      scene.mark("triangle", 0, 0, 6, "lab-fill-target");
      scene.text(1.2, -1.8, scene.w > 200 ? "radar" : "");
      for (const target of targets(lab.state.fixed))
        scene.ellipse(target.x, target.y, target, 3 * lab.state.inflate, "lab-soft");
      const place = walked?.at(-1) ?? TRUTH;
      targets(lab.state.moving).forEach((target, k) => {
        const there = d2d.move(target, place);
        scene.ellipse(there.x, there.y, there, 3 * lab.state.inflate, "lab-line lab-moving");
        if (walked) scene.target("moving", there.x, there.y);
        if (marks[k]) marks[k].style.fillOpacity = found.shares[k];
      });
    }

    // ---- The cost over the translation, through the optimum's rotation --------------------------------------------------------------

    map.handle({
      name: "Start of the descent, relative to the truth",
      step: 0.25,
      low: -REACH,
      high: REACH,
      draw: [svg("circle", { class: "lab-start-rim", r: 8 }), svg("circle", { class: "lab-start", r: 8 })],
      get: () => [lab.state.x, lab.state.y],
      set: (x, y) => Object.assign(lab.state, { x, y }),
    });

    // How many pairs of a target and a component are worked out between two frames: what takes about 8 ms here. At rest, 3e6.
    let budget = 2e5;
    function paint(found, fine) {
      const { fixed, moving, cost } = lab.state;
      const pairs = (fixed.length / 2) * (moving.length / 2) * (cost === "robust" ? 2 : 1);
      const size = Math.round(
        fine ? Math.min(100, Math.sqrt(3e6 / pairs)) : labs.clamp(Math.sqrt(budget / pairs), 14, 64),
      );
      const cells = ([low, high], middle) =>
        range(low, high, 2 * size + 1)
          .filter((_, i) => i % 2)
          .map((each) => each + middle);
      const began = performance.now();
      map.paint(d2d.surface(problem(), cells(map.x, TRUTH[0]), cells(map.y, TRUTH[1]), found.theta[2]), size, size);
      const ms = performance.now() - began;
      if (!fine) budget = labs.clamp(budget * labs.clamp(8 / ms, 0.5, 1.4), 2e4, 3e5);
      lab.painted = { size, ms };
    }

    // ---- The basin: the starts that end where one at the truth does -----------------------------------------------------------

    const CELLS = 25; // of a row of starts
    const schedule = () => (lab.state.anneal ? d2d.ANNEALED : [1]);
    let basin = {}; // of the present problem: its optimum, starts that arrive, how many were tried, the farthest by hand

    /** Whether a descent arrived. */
    function arrived(theta) {
      const { x, y, basin: shown, ...rest } = lab.state,
        key = JSON.stringify(rest);
      if (key !== basin.key)
        basin = { key, aim: d2d.register(problem(), TRUTH, schedule()).theta, starts: [], tried: 0, record: 0 };
      return theta.every((each, i) => Math.abs(each - basin.aim[i]) < 1e-3);
    }

    /** Try a few starts more, and paint those that arrive. */
    function paintBasin() {
      const began = performance.now();
      arrived(TRUTH); // another problem begins anew
      while (basin.tried < CELLS ** 2 && performance.now() - began < 10) {
        const cell = [basin.tried % CELLS, Math.floor(basin.tried / CELLS)],
          [x, y] = cell.map((each) => REACH * ((2 * each + 1) / CELLS - 1)),
          from = [TRUTH[0] + x, TRUTH[1] + y, start()[2]];
        if (arrived(d2d.register(problem(), from, schedule()).theta)) basin.starts.push([x, y]);
        basin.tried++;
      }
      basin.starts.forEach(([x, y]) => map.mark("square", x, y, 3, "lab-basin"));
      if (basin.tried < CELLS ** 2) lab.update();
    }

    let refining = null;
    function drawMap(found, others) {
      map.extent([-REACH, REACH], [-REACH, REACH]);
      map.clear();
      paint(found, false);
      clearTimeout(refining);
      refining = setTimeout(() => paint(found, true), 250);
      const off = (theta) => [theta[0] - TRUTH[0], theta[1] - TRUTH[1]];
      for (const axis of ["x", "y"]) map.rule(axis, 0, "lab-cross");
      if (lab.state.basin) paintBasin();
      if (!watched) return;
      const path = walked ?? found.path;
      map.line(path.map(off), "lab-over");
      path.slice(1).forEach((theta) => map.mark("circle", ...off(theta), 2.5, "lab-step"));
      for (const [name, other] of Object.entries(walked ? {} : others)) {
        const [x, y] = off(other.theta),
          own = name === lab.state.cost;
        if (own && other.covariance) {
          map.ellipse(x, y, labs.planar(other.covariance), 3, "lab-halo");
          map.ellipse(x, y, labs.planar(other.covariance), 3, `lab-line lab-${name} lab-strong`);
        }
        map.mark(COSTS[name].mark, x, y, own ? 6 : 4.5, `lab-optimum lab-fill-${name}`);
      }
    }

    // ---- What came out ---------------------------------------------------------------------------------------------------------------

    function tell(others) {
      const rows = Object.entries(others).map(([name, found]) => {
        const error = found.theta.map((each, i) => each - TRUTH[i]);
        const sigma = found.covariance ? [0, 1, 2].map((i) => Math.sqrt(found.covariance[i][i])) : null;
        const pm = (i, unit, decimals) =>
          `${number(error[i] * unit, decimals)}${sigma ? ` ±\u00a0${number(sigma[i] * unit, decimals)}` : ""}`;
        return [
          [labs.inlineMark(name), ` ${COSTS[name].name}`],
          pm(0, 1, 2),
          pm(1, 1, 2),
          pm(2, 1 / DEGREE, 1),
          found.covariance ? number(d2d.nees(error, found.covariance), 1) : "none",
        ];
      });
      const own = others[lab.state.cost];
      const out = counts(lab.state.moving)
        .filter((k) => own.shares[k] < 0.5)
        .map(letter);
      const end = own.converged
        ? `goes in ${own.iterations} steps to an optimum that is `
        : `has not converged after ${own.iterations} steps, and is `;
      const rejected =
        lab.state.cost === "robust" ? ` Taken for outliers: ${out.length ? out.join(", ") : "none"}.` : "";
      const words = [` ${COSTS[lab.state.cost].name} ${end}`, ...labs.verdict(own, TRUTH), rejected];
      lab.tell(
        [html("p", {}, "From the start the ", labs.inlineMark(lab.state.cost), ...words), challenge(own)],
        lab.table(["error ± stated σ", "x (m)", "y (m)", "rotation (°)", "NEES"], rows),
      );
    }

    /** How far from the truth a start may be and still arrive. */
    function challenge({ theta }) {
      const far = Math.hypot(lab.state.x, lab.state.y),
        arrives = arrived(theta);
      if (arrives) basin.record = Math.max(basin.record, far);
      return html(
        "p",
        {},
        `Challenge: this start, ${number(far, 1)} m away, ${arrives ? "arrives" : "does not arrive"} `,
        `where one at the truth ends.${basin.record ? ` Your record: ${number(basin.record, 1)} m.` : ""}`,
      );
    }

    function watch() {
      const { path } = lab.result.found;
      watched = true;
      lab.follow(
        path,
        3,
        (theta, passed) => (walked = [...path.slice(0, passed + 1), theta]),
        () =>
          setTimeout(() => {
            walked = null;
            lab.begin();
            lab.update();
          }, 900),
      );
    }

    function draw() {
      const noise = d2d.normals(lab.state.draw);
      const observe = (p) => {
        const distance = Math.hypot(p.x, p.y) + SIGMA_RANGE * noise(),
          azimuth = Math.atan2(p.y, p.x) + SIGMA_AZIMUTH * noise();
        return [distance * Math.cos(azimuth), distance * Math.sin(azimuth)].map((each) => Number(each.toFixed(2)));
      };
      lab.state.fixed = TRUE.flatMap(observe);
      lab.state.moving = TRUE.map((p) => d2d.move(p, home)).flatMap(observe);
    }

    /** A target more in M, without a partner, at places spread over the field of view. */
    function addOutlier() {
      const n = lab.state.moving.length / 2;
      if (n >= MOST) return;
      const spots = [
        [24, -6],
        [12, 14],
        [35, 8],
        [9, -3],
        [27, 17],
        [34, -15],
        [6, -14],
        [18, 3],
        [26, 5],
        [15, -16],
        [36, 1],
        [8, 8],
      ];
      const [x, y] = spots[(n - 8 + spots.length) % spots.length],
        p = d2d.move({ x, y }, home);
      lab.state.moving.push(Number(p.x.toFixed(2)), Number(p.y.toFixed(2)));
    }

    lab.python = () => {
      const { inflate, anneal } = lab.state,
        sigmas = [SIGMA_RANGE, SIGMA_AZIMUTH].map((sigma) => labs.short(sigma * inflate));
      return labs.script(
        `previous = ${labs.polarSet(targets(lab.state.fixed), ...sigmas)}`,
        `current = ${labs.polarSet(targets(lab.state.moving), ...sigmas)}`,
        `cost = ${labs.costOf(problem())}`,
        `start = ${labs.list(start())}`,
        `estimate = register(previous, current, cost, start${anneal ? ", ANNEALED" : ""})`,
        `error = estimate.theta - [${TRUTH[0]}, ${TRUTH[1]}, np.deg2rad(15)]`,
        "sigma = np.sqrt(np.diag(estimate.covariance))",
        "nees = error @ np.linalg.solve(estimate.covariance, error)",
        'print(f"x {error[0]:.2f} ± {sigma[0]:.2f} m, y {error[1]:.2f} ± {sigma[1]:.2f} m")',
        'print(f"rotation {np.rad2deg(error[2]):.1f} ± {np.rad2deg(sigma[2]):.1f} degrees, NEES {nees:.1f}")',
      );
    };

    lab.changed = (key) => {
      walked = null;
      watched = key !== "reset";
    };
    lab.build(
      [
        bar(lab.costs()),
        labs.row(
          panel(html("span", { class: "lab-key" }, ...labs.setKey("fixed", "moving")), scene),
          panel("Cost, dark is low; ring: start", map),
        ),
        bar(
          lab.button("Watch the descent", watch),
          lab.next("Next draw", "draw", draw),
          lab.button("Add an outlier", () => {
            addOutlier();
            lab.touched("outlier");
          }),
          lab.check("anneal", "anneal (σ × 10 to 1)"),
          lab.check("basin", "paint the basin"),
          ...lab.tools(),
        ),
        bar(
          lab.slider("turn", {
            label: "rotation of the start",
            min: -60,
            max: 60,
            step: 1,
            show: (v) => `${number(v, 0)}°`,
          }),
          lab.slider("inflate", { label: "inflate every σ by", min: 1, max: 10, step: 0.1, show: (v) => number(v, 1) }),
        ),
        labs.extra(...lab.outlierSliders()),
      ],
      () => {
        const others = Object.fromEntries(
          Object.keys(COSTS).map((name) => [name, d2d.register(problem(name), start(), schedule())]),
        );
        const found = others[lab.state.cost];
        lab.result = { problem: problem(), start: start(), found };
        drawScene(found);
        drawMap(found, others);
        tell(others);
      },
    );
  },
);
