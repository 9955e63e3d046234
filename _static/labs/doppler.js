// The Doppler fan: one scan of a radar on a car. Steer the velocity until the predicted Doppler velocities meet the measured
// ones; a mover sticks out, unless it crosses the line of sight.
labs.define(
  "doppler",
  () => ({
    vx: 4.5, // m/s, m/s, deg/s: what is steered
    vy: 0,
    w: 0,
    px: 22, // m: the mover, in the vehicle frame
    py: 2.5,
    speed: 5, // m/s, over ground
    heading: 0, // deg from straight ahead
    use: "both",
    drive: 0,
  }),
  (lab) => {
    const { svg, html, targetMark, fixed: number, range, bar, corrupted } = labs;
    const DEGREE = Math.PI / 180,
      MOUNTING = { x: 3.6, y: 0, yaw: 0 },
      INTERVAL = 0.1;
    const SIGMA_RANGE = 0.15,
      SIGMA_AZIMUTH = 0.5 * DEGREE,
      SIGMA_DOPPLER = 0.1;
    lab.sound = (state) => ["both", "positions"].includes(state.use) && state.drive >= 0;

    // a street: a wall to the left, parked cars to the right, poles
    const STREET = [
      [9, 6.5],
      [12, 6.6],
      [15, 6.4],
      [18, 6.6],
      [21, 6.5],
      [24, 6.6],
      [28, 6.5],
      [32, 6.4],
      [8.5, -4.2],
      [11, -4.5],
      [13, -4.3],
      [17, -4.4],
      [19.5, -4.5],
      [25, -4.3],
      [27.5, -4.5],
      [34, -4.4],
      [14, 1.2],
      [30, -1],
      [36, 3],
      [20, -8],
      [26, 9.5],
    ].map(([x, y]) => ({ x, y }));

    const fan = lab.plot({
      label: "Doppler velocity over azimuth",
      xlabel: "azimuth (°), left is positive",
      ylabel: "Doppler (m/s)",
      shape: 0.75,
      narrow: 0.52,
    });
    const top = lab.plot({
      label: "The scan from above",
      xlabel: "x (m), ahead",
      ylabel: "y (m), left",
      shape: 0.75,
      narrow: 0.42,
      equal: true,
    });

    const along = (length, angle) => [length * Math.cos(angle), length * Math.sin(angle)];
    const steered = () => [lab.state.vx, lab.state.vy, lab.state.w * DEGREE];

    /** The velocity that the scans were made at: not shown until asked for. */
    function truth() {
      const noise = d2d.normals(100 + lab.state.drive);
      return lab.state.drive === 0 ? [6, 0.2, 15 * DEGREE] : [7 + 2 * noise(), 0.3 * noise(), 15 * DEGREE * noise()];
    }

    /** The previous and the current scan; the mover is the last target of both. */
    function scans() {
      const { px, py, speed, heading, drive } = lab.state,
        velocity = truth(),
        noise = d2d.normals(drive);
      const own = along(speed, heading * DEGREE);
      const { motion } = d2d.exponential(...velocity.map((each) => each * INTERVAL));
      const seen = ({ x, y }) => {
        const distance = Math.hypot(x - MOUNTING.x, y - MOUNTING.y) + SIGMA_RANGE * noise();
        const azimuth = Math.atan2(y - MOUNTING.y, x - MOUNTING.x) + SIGMA_AZIMUTH * noise();
        const target = d2d.fromPolar(distance, azimuth, SIGMA_RANGE, SIGMA_AZIMUTH);
        return { ...target, x: target.x + MOUNTING.x, azimuth };
      };
      const places = [...STREET, { x: px, y: py }];
      const before = places.map((place, i) => {
        const there = d2d.move(
          i < STREET.length ? place : { x: px - own[0] * INTERVAL, y: py - own[1] * INTERVAL },
          motion,
        );
        return seen(there);
      });
      const now = places.map((place, i) => {
        const target = seen(place),
          angle = Math.atan2(place.y - MOUNTING.y, place.x - MOUNTING.x);
        const moves = i < STREET.length ? 0 : own[0] * Math.cos(angle) + own[1] * Math.sin(angle);
        const doppler = predicted(velocity, angle) + moves + SIGMA_DOPPLER * noise();
        return {
          ...target,
          measured: doppler,
          doppler: d2d.dopplerMeasurement(doppler, target.azimuth, SIGMA_DOPPLER, SIGMA_AZIMUTH, MOUNTING),
        };
      });
      return { before, now };
    }

    function predicted(velocity, azimuth) {
      const { gain } = d2d.dopplerGradients(azimuth, MOUNTING);
      return gain.reduce((sum, each, i) => sum + each * velocity[i], 0);
    }

    /** Whether a measured Doppler velocity agrees with the steered one: within three standard deviations. */
    function agrees(target, velocity) {
      const { slope } = d2d.dopplerGradients(target.azimuth, MOUNTING),
        along = slope.reduce((sum, each, i) => sum + each * velocity[i], 0);
      return (
        Math.abs(target.measured - predicted(velocity, target.azimuth)) <
        3 * Math.hypot(SIGMA_DOPPLER, SIGMA_AZIMUTH * along)
      );
    }

    function problem({ before, now }) {
      const moving = lab.state.use === "both" ? now : now.map(({ doppler, ...target }) => target);
      return { fixed: before, moving, fusion: "likelihood", outlier: corrupted(), interval: INTERVAL, dopplerWidth: 4 };
    }

    // ---- Pictures ---------------------------------------------------------------------------------------------------------------

    top.handle({
      name: "The mover",
      step: 0.5,
      low: -20,
      high: 38,
      draw: [targetMark("moving"), targetMark("outlier", 11), svg("text", { class: "lab-label", y: 24, "text-anchor": "middle" }, "mover")],
      get: () => [lab.state.px, lab.state.py],
      set: (x, y) => Object.assign(lab.state, { px: Math.max(6, x), py: y }),
    });

    /** Filled if the steered velocity explains the target. */
    const look = (each) => (agrees(each, steered()) ? "lab-set-moving" : "lab-disagrees");

    function drawFan({ now }) {
      fan.extent([-56, 56], [Math.min(-8, -lab.state.vx, ...now.map(({ measured }) => measured)) - 2, 4]);
      fan.clear();
      fan.rule("y", 0, "lab-zero");
      const angles = range(-56, 56, 113);
      fan.line(
        angles.map((angle) => [angle, predicted(steered(), angle * DEGREE)]),
        "lab-robust lab-strong",
      );
      now.forEach((each, k) => {
        const x = each.azimuth / DEGREE,
          expected = predicted(steered(), each.azimuth);
        fan.segment(x, each.measured, x, expected, "lab-zero");
        fan.target("moving", x, each.measured, 4, look(each));
        if (k < now.length - 1) return;
        fan.target("outlier", x, each.measured, 9);
        fan.text(x, each.measured, "mover", { dy: -14, "text-anchor": "middle" });
      });
    }

    function drawTop({ now }) {
      top.extent([-1, 38], [-11, 12]);
      top.clear();
      const box = [
        [-1, -0.9],
        [3.6, -0.9],
        [3.6, 0.9],
        [-1, 0.9],
        [-1, -0.9],
      ];
      top.line(box, "lab-line");
      now.forEach((target, k) => {
        const good = agrees(target, steered()),
          [dx, dy] = along(0.5 * target.measured, target.azimuth);
        top.segment(MOUNTING.x, MOUNTING.y, target.x, target.y, "lab-ray");
        // the Doppler velocity along the line of sight: 1 m/s is 0.5 m
        top.segment(target.x, target.y, target.x + dx, target.y + dy, good ? "lab-robust lab-strong" : "");
        if (k < now.length - 1) top.target("moving", target.x, target.y, 4, look(target));
      });
      const [vx, vy, w] = steered(),
        sensor = [vx - w * MOUNTING.y, vy + w * MOUNTING.x];
      top.segment(MOUNTING.x, 0, MOUNTING.x + sensor[0], sensor[1], "lab-ink lab-strong");
      top.mark("square", MOUNTING.x, 0, 4, "lab-fill-target");
      const { px, py, speed, heading } = lab.state,
        [dx, dy] = along(speed, heading * DEGREE);
      top.segment(px, py, px + dx, py + dy, "lab-ink lab-strong");
    }

    // ---- What came out ---------------------------------------------------------------------------------------------------------------

    const sub = (name, index) => [name, html("sub", {}, index)];
    let revealed = false;
    function tell({ now }, found) {
      const [vx, vy, w] = steered(),
        agree = now.filter((target) => agrees(target, steered())).length;
      const cells = (velocity, covariance) =>
        velocity.map((each, i) => {
          const unit = i === 2 ? 1 / DEGREE : 1,
            decimals = i === 2 ? 1 : 2;
          return (
            number(each * unit, decimals) +
            (covariance ? ` ±\u00a0${number(Math.sqrt(covariance[i][i]) * unit, decimals)}` : "")
          );
        });
      const share = Math.round(100 * found.shares[now.length - 1]);
      lab.tell(
        html(
          "p",
          {},
          html("strong", {}, `${agree} of ${now.length} targets`),
          ` agree with the velocity that you steer. The mover is an inlier with a probability of ${share} %.`,
        ),
        html(
          "p",
          {},
          `The curve depends on the velocity of the radar only: ahead ${number(vx - w * MOUNTING.y)} m/s, to the left `,
          ...sub("v", "y"),
          " + ω ",
          ...sub("x", "s"),
          ` = ${number(vy + w * MOUNTING.x)} m/s, with `,
          ...sub("x", "s"),
          ` = ${MOUNTING.x} m.`,
        ),
        lab.table(
          ["", [...sub("v", "x"), " (m/s)"], [...sub("v", "y"), " (m/s)"], "ω (°/s)"],
          [
            ["steered", ...cells(steered())],
            [
              [labs.inlineMark("robust"), " robust likelihood, started at the steered velocity"],
              ...(found.converged ? cells(found.theta, found.covariance) : ["not converged", "", ""]),
            ],
            ...(revealed ? [["truth", ...cells(truth())]] : []),
          ],
        ),
      );
    }

    lab.changed = (key) => {
      if (key === "reset" || key === "drive") revealed = false;
    };
    const steer = (target) =>
      lab.follow(
        [steered(), target],
        1,
        ([vx, vy, w]) => Object.assign(lab.state, { vx, vy, w: w / DEGREE }),
        () => lab.touched(),
      );

    lab.python = () => {
      const { before, now } = scans();
      const scan = (time, targets, doppler) =>
        `RadarScan(\n    ${time},\n    ${labs.list(targets.map(({ x, y }) => Math.hypot(x - MOUNTING.x, y)))},\n` +
        `    ${labs.list(targets.map(({ azimuth }) => azimuth))},\n    ${doppler},\n` +
        `    ${SIGMA_RANGE}, np.deg2rad(0.5), ${SIGMA_DOPPLER},\n)`;
      return labs.script(
        `previous = ${scan(0, before, `np.zeros(${before.length})`)}`,
        `current = ${scan(INTERVAL, now, labs.list(now.map(({ measured }) => measured)))}`,
        `estimate = estimate_ego_motion(`,
        `    previous, current, Mounting(${MOUNTING.x}),`,
        `    initial=${labs.list(steered())}, doppler=${lab.state.use === "both" ? "True" : "False"},`,
        ")",
        "v, sigma = estimate.theta, np.sqrt(np.diag(estimate.covariance))",
        'print(f"v_x {v[0]:.2f} ± {sigma[0]:.2f} m/s, v_y {v[1]:.2f} ± {sigma[1]:.2f} m/s")',
        'print(f"omega {np.rad2deg(v[2]):.1f} ± {np.rad2deg(sigma[2]):.1f} degrees/s")',
      );
    };

    const word = (text) => html("span", { class: "lab-word" }, text); // where there is room
    const speed = (v) => `${number(v, 1)} m/s`;
    lab.build(
      [
        bar(
          lab.slider("vx", {
            label: html("span", {}, word("ahead "), ...sub("v", "x")),
            min: 0,
            max: 14,
            step: 0.05,
            show: (v) => `${number(v)} m/s`,
          }),
          lab.slider("vy", {
            label: html("span", {}, word("left "), ...sub("v", "y")),
            min: -4,
            max: 4,
            step: 0.05,
            show: (v) => `${number(v)} m/s`,
          }),
          lab.slider("w", { label: html("span", {}, word("yaw rate "), "ω"), min: -50, max: 50, step: 0.5, show: (v) => `${number(v, 1)} °/s` }),
        ),
        labs.row(fan.box, top.box),
        labs.legend(...labs.setKey("moving", "outlier"), html("span", {}, "hollow: does not agree")),
        labs.extra(
          lab.slider("speed", { label: "mover’s speed", min: 0, max: 10, step: 0.1, show: speed }),
          lab.slider("heading", {
            label: "its direction",
            min: -180,
            max: 180,
            step: 5,
            show: (v) => `${number(v, 0)}°`,
          }),
        ),
        bar(lab.choice("use", "Use", { both: "positions and Doppler", positions: "positions only" })),
        bar(
          lab.button("Go to the estimate", () => {
            if (lab.result.found.converged) steer(lab.result.found.theta);
          }),
          lab.button("Show truth", () => {
            revealed = true;
            lab.update();
          }),
          lab.next("New drive", "drive"),
          ...lab.tools(),
        ),
      ],
      () => {
        const pair = scans(),
          posed = problem(pair),
          found = d2d.minimise(posed, steered());
        lab.result = { problem: posed, start: steered(), found };
        drawFan(pair);
        drawTop(pair);
        tell(pair, found);
      },
    );
  },
);
