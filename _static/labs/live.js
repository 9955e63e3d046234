// The live picture of the first page: lay one scan onto the other by hand, and see what the cost makes of it.
labs.define(
  "live",
  () => ({
    x: 0, // the motion at which the current scan is drawn: m, m, deg
    y: 2,
    turn: 0,
    outlier: 0,
    ox: 9.81, // m, in the current scan's frame: what has no partner in the previous scan
    oy: -11.46,
    cost: "likelihood",
  }),
  (lab) => {
    const { svg, html, targetMark, fixed: number, clamp, range, bar, panel, formOf, COSTS } = labs;
    const DEGREE = Math.PI / 180,
      TRUTH = [2, 0.5, 10 * DEGREE],
      SIGMA_RANGE = 0.15,
      SIGMA_AZIMUTH = 0.03,
      REACH = 17;
    lab.sound = (state) => state.cost in COSTS;

    const PLACES = [
      [7, 3],
      [9.5, 6.5],
      [14.5, 4],
      [12, 0.5],
      [16, -2.5],
      [7.5, -3.5],
      [11.5, -6],
    ];
    const home = d2d.inverseMotion(TRUTH),
      noise = d2d.normals(4);
    const measured = (range_, azimuth) => d2d.fromPolar(range_, azimuth, SIGMA_RANGE, SIGMA_AZIMUTH);
    const observe = ({ x, y }) =>
      measured(Math.hypot(x, y) + SIGMA_RANGE * noise(), Math.atan2(y, x) + SIGMA_AZIMUTH * noise());
    const previous = PLACES.map(([x, y]) => observe({ x, y })),
      current = PLACES.map(([x, y]) => observe(d2d.move({ x, y }, home)));

    const scene = lab.plot({
      label: "Both scans",
      xlabel: "x (m)",
      ylabel: "y (m)",
      shape: 0.98,
      narrow: 0.5,
      equal: true,
    });
    const curve = lab.plot({
      label: "The cost over the shift along x",
      xlabel: "shift along x (m)",
      ylabel: "cost",
      shape: 0.55,
      narrow: 0.56,
    });
    const error = lab.plot({
      label: "Error of the registration in rotation and y with its 3-sigma ellipse",
      xlabel: "rotation (°)",
      ylabel: "y (m)",
      shape: 0.5,
      narrow: 0.56,
    });

    const pose = () => [lab.state.x, lab.state.y, lab.state.turn * DEGREE];
    const outlier = () => measured(Math.hypot(lab.state.ox, lab.state.oy), Math.atan2(lab.state.oy, lab.state.ox));
    const seen = () => [...current, ...(lab.state.outlier ? [outlier()] : [])];
    const problem = () => ({
      fixed: previous,
      moving: seen(),
      ...formOf(lab.state.cost),
    });

    /** How far ahead of the radar the ring is, m: less than REACH where the picture ends. */
    function reach() {
      const [, y, phi] = pose(),
        room = (phi > 0 ? scene.y[1] - 1 - y : y - scene.y[0] - 1) / Math.abs(Math.sin(phi));
      return Math.max(3, Math.min(REACH, room, (scene.x[1] - 1 - lab.state.x) / Math.cos(phi)));
    }

    const body = svg("g");
    scene.handle({
      name: "The current scan: move it",
      step: 0.1,
      low: -12,
      high: 12,
      draw: [svg("path", { class: "lab-knob", d: "M9,0L-6,7V-7z" }), body],
      get: () => [lab.state.x, lab.state.y],
      set: (x, y) => Object.assign(lab.state, { x: clamp(x, -3, 12), y: clamp(y, -8, 7) }),
    });
    scene.handle({
      name: "The current scan: turn it",
      step: 0.3,
      low: -30,
      high: 40,
      draw: svg("circle", { class: "lab-turn", r: 8 }),
      get: () => {
        const [x, y, phi] = pose();
        return [x + reach() * Math.cos(phi), y + reach() * Math.sin(phi)];
      },
      say: () => `${number(lab.state.turn, 0)} degrees`,
      set: (x, y) => {
        lab.state.turn = clamp(Math.atan2(y - lab.state.y, x - lab.state.x) / DEGREE, -60, 60);
      },
    });
    scene.handle({
      name: "The outlier: move it",
      step: 0.2,
      low: -20,
      high: 20,
      draw: [targetMark("moving"), targetMark("outlier", 11), svg("text", { x: 14, y: 4 }, "outlier")],
      hidden: () => !lab.state.outlier,
      get: () => {
        const { x, y } = d2d.move(outlier(), pose());
        return [x, y];
      },
      set: (x, y) => {
        const place = d2d.move({ x: clamp(x, 3, 19), y: clamp(y, -11, 10) }, d2d.inverseMotion(pose()));
        Object.assign(lab.state, { ox: place.x, oy: place.y });
      },
    });

    function drawScene(found) {
      scene.extent([-4, 20], [-12, 11]);
      scene.clear();
      scene.mark("triangle", 0, 0, 7, "lab-line");
      scene.text(0, 0, "radar", { dy: 22, "text-anchor": "middle" });
      for (const each of previous) {
        scene.ellipse(each.x, each.y, each, 3, "lab-soft");
        scene.target("fixed", each.x, each.y, 3);
      }
      const [x, y, phi] = pose();
      scene.segment(x, y, x + reach() * Math.cos(phi), y + reach() * Math.sin(phi), "lab-ray");
      const scan = svg("path", { class: "lab-reach", d: "M0,0" }); // the whole of it can be dragged
      body.replaceChildren(scan);
      seen().forEach((each, k) => {
        const there = d2d.move(each, pose());
        scene.ellipse(there.x, there.y, there, 3, "lab-line lab-moving");
        if (k === PLACES.length) return; // it has a handle of its own
        const [cx, cy] = [scene.X(there.x) - scene.X(x), scene.Y(there.y) - scene.Y(y)];
        scan.setAttribute("d", `${scan.getAttribute("d")}L${cx},${cy}`);
        body.append(
          svg("circle", { class: "lab-reach", r: 16, cx, cy }),
          svg("g", { transform: `translate(${cx} ${cy})` }, targetMark("moving", 5)),
        );
      });
      const { theta, covariance } = found;
      if (arrived && covariance)
        scene.ellipse(theta[0], theta[1], labs.planar(covariance), 3, `lab-line lab-${lab.state.cost} lab-strong`);
    }

    function drawCurve() {
      const xs = range(-8, 8, 241),
        costs = d2d.surface(problem(), xs, [lab.state.y], lab.state.turn * DEGREE);
      const low = costs.reduce((a, b) => Math.min(a, b), Infinity),
        top = Math.min(600, costs.reduce((a, b) => Math.max(a, b), -Infinity) - low);
      curve.extent([-8, 8], [-0.06 * top, 1.06 * top]);
      curve.clear();
      curve.rule("x", TRUTH[0], "lab-truth");
      curve.line(
        xs.map((x, i) => [x, costs[i] - low]),
        `lab-${lab.state.cost} lab-strong`,
      );
      const here = Math.min(top, d2d.evaluate(problem(), pose()).value - low);
      curve.mark("circle", lab.state.x, here, 7, "lab-knob");
      curve.text(lab.state.x, here, "now", { dx: -11, dy: 4, "text-anchor": "end" });
      curve.text(TRUTH[0], curve.y[1], "truth", { dx: -4, dy: 14, "text-anchor": "end" });
    }

    function drawError(found) {
      // rotation and y: an error of one looks like one of the other, so together they show what an outlier does
      const turn = (found.theta[2] - TRUTH[2]) / DEGREE,
        y = found.theta[1] - TRUTH[1],
        c = found.covariance;
      const about = (value, least) => [-1, 1].map((sign) => sign * Math.max(least, 1.3 * Math.abs(value)));
      error.extent(about(turn, 10), about(y, 1.5));
      error.clear();
      for (const axis of ["x", "y"]) error.rule(axis, 0, "lab-truth");
      if (!arrived) return;
      if (c) {
        const own = { xx: c[2][2] / DEGREE ** 2, xy: c[1][2] / DEGREE, yy: c[1][1] };
        error.ellipse(turn, y, own, 3, `lab-line lab-${lab.state.cost} lab-strong`);
      }
      error.mark(COSTS[lab.state.cost].mark, turn, y, 6, `lab-fill-${lab.state.cost}`);
    }

    function tell(found) {
      const { x, y, turn, cost } = lab.state,
        now = `Shifted by ${number(x)} m and ${number(y)} m, turned by ${number(turn, 0)}°.`,
        end = [labs.inlineMark(cost), ` The ${COSTS[cost].name} ends `, ...labs.verdict(found, TRUTH)];
      const outcome = html("p", { class: "lab-outcome" }, ...(arrived ? end : [now]));
      lab.tell([outcome, challenge()]);
    }

    const best = { summing: 0, likelihood: 0, robust: 0 };
    /** How wrong the outlier makes a covariance, where the start is not to blame. */
    function challenge() {
      if (!lab.state.outlier) return html("p", {}, "Challenge: add the outlier, and drag it to where the cost errs most.");
      const { theta, covariance: stated } = d2d.register(problem(), TRUTH),
        off = theta.map((each, i) => each - TRUTH[i]),
        score = stated ? Math.sqrt(d2d.nees(off, stated)) : 0,
        { cost } = lab.state;
      best[cost] = Math.max(best[cost], score);
      return html(
        "p",
        {},
        `Challenge: from the truth, the ${COSTS[cost].name} errs by ${number(score, 1)} of its standard deviations. `,
        `Your record: ${number(best[cost], 1)}.`,
      );
    }

    let arrived = false; // whether the scan is where the registration took it: the outcome is not told before
    lab.changed = (key) => (arrived = key === "arrived");

    function slide() {
      const { path } = lab.result.found;
      lab.follow(
        path,
        2.5,
        ([x, y, phi]) => Object.assign(lab.state, { x, y, turn: phi / DEGREE }),
        () => lab.touched("arrived"),
      );
    }

    lab.python = () =>
      labs.script(
        `previous = ${labs.polarSet(previous, SIGMA_RANGE, SIGMA_AZIMUTH)}`,
        `current = ${labs.polarSet(seen(), SIGMA_RANGE, SIGMA_AZIMUTH)}`,
        `cost = ${labs.costOf(problem())}`,
        `estimate = register(previous, current, cost, initial=${labs.list(pose())})`,
        `error = estimate.theta - [${TRUTH[0]}, ${TRUTH[1]}, np.deg2rad(10)]`,
        'print(f"{np.hypot(*error[:2]):.2f} m and {abs(np.rad2deg(error[2])):.1f} degrees off the truth")',
      );

    lab.build(
      [
        bar(lab.costs(), lab.button("Register from here", slide), lab.check("outlier", "outlier")),
        labs.row(
          panel("Drag the purple scan, turn it by the ring", scene),
          html(
            "div",
            { class: "lab-pair" },
            panel("Cost of a shift along x", curve),
            panel("Its error, and 3σ", error),
          ),
        ),
        bar(...labs.setKey("fixed", "moving"), ...lab.tools()),
      ],
      () => {
        const found = d2d.register(problem(), pose());
        lab.result = { problem: problem(), start: pose(), found };
        drawScene(found);
        drawCurve();
        drawError(found);
        tell(found);
      },
    );
  },
);
