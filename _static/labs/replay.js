// A drive on a public road, replayed: the car from above, two scans of its radar that slide onto each other, and whether the
// error of each velocity lies in the ellipse stated for it. The estimates are in replay_data.js, which tools/replay_data.py
// writes and describes; the street beside the car, and so its targets, are made up.
labs.define(
  "replay",
  () => ({
    shown: 0, // estimates so far
    covariance: "hessian",
  }),
  (lab) => {
    const { svg, html, fixed: number, clamp, bar, panel } = labs;
    const NAMES = { __proto__: null, hessian: "inverse Hessian", budget: "budget" };
    const SECONDS = 20; // that the whole drive takes, of 30 on the road
    const LEVEL = d2d.chiSquareQuantile(0.95, 2),
      BLIND = 1; // s for which the car goes on by an estimate alone
    const HORIZON = 0.3, // s between the two scans
      CYCLE = 0.9; // s from one pair of scans that is shown to the next

    const column = (name) => replayData[name],
      times = column("time"),
      poses = times.map((_, i) => ["x", "y", "yaw"].map((name) => column(name)[i])),
      errors = times.map((_, i) => ["errorX", "errorY"].map((name) => BLIND * column(name)[i])),
      LAST = times.length;
    const stated = (name, i) => {
      const [xx, xy, yy] = ["XX", "XY", "YY"].map((entry) => BLIND ** 2 * column(name + entry)[i]);
      return { xx, xy, yy };
    };
    const isInside = (error, { xx, xy, yy }) => {
      const matrix = [
        [xx, xy],
        [xy, yy],
      ];
      return d2d.nees(error, matrix) <= LEVEL;
    };
    const inside = Object.fromEntries(
      Object.keys(NAMES).map((name) => [name, errors.map((error, i) => isInside(error, stated(name, i)))]),
    );
    lab.sound = ({ shown, covariance }) => covariance in NAMES && Number.isInteger(shown) && shown >= 0 && shown <= LAST;

    // ---- The street from above ----------------------------------------------------------------------------------------------

    const WIDTH = 720, // of the drawing, px at most; the car looks to the right
      CAR = 130,
      SCALE = 6.5, // px/m
      REACH = 75, // m
      VIEW = 0.9; // rad to both sides
    const random = ((seed) => () => (seed = (seed * 16807) % 2147483647) / 2147483647)(7);
    const ahead = ([x, y, yaw], along, left) => ({
      x: x + along * Math.cos(yaw) - left * Math.sin(yaw),
      y: y + along * Math.sin(yaw) + left * Math.cos(yaw),
    });
    // what stands beside the road: something every few metres on one side or the other, on beyond the end of the drive
    const beyond = Array.from({ length: 40 }, (_, i) => [...Object.values(ahead(poses.at(-1), 2 * i, 0)), poses.at(-1)[2]]),
      road = [...poses, ...beyond];
    const objects = road.flatMap((pose) =>
      random() < 0.9 ? [ahead(pose, 2 * random(), (random() < 0.5 ? -1 : 1) * (6 + 9 * random() ** 2))] : [],
    );

    /** The pose at a time, linear between two estimates. */
    function poseAt(time) {
      const later = times.findIndex((each) => each > time),
        next = later < 0 ? LAST - 1 : Math.max(later, 1),
        share = clamp((time - times[next - 1]) / (times[next] - times[next - 1]), 0, 1);
      return poses[next - 1].map((value, i) => value + share * (poses[next][i] - value));
    }

    /** What the radar sees from a pose, in the vehicle's frame; each scan has noise of its own. */
    function seenFrom(pose, seed) {
      const noise = d2d.normals(seed),
        back = d2d.inverseMotion(pose);
      return objects
        .map((each) => d2d.move(each, back))
        .filter(({ x, y }) => Math.hypot(x, y) < REACH && Math.abs(Math.atan2(y, x)) < VIEW)
        .map(({ x, y }) => ({ x: x + 0.25 * noise(), y: y + 0.25 * noise() }));
    }

    const world = svg("g"),
      scans = svg("g"),
      beam = svg("path", { class: "lab-beam", d: "" }),
      label = "The car from above, with the targets of its radar",
      street = svg("svg", { class: "lab-street", role: "img", "aria-label": label });
    for (const [left, name] of Object.entries({ "-4": "lab-kerb", 0: "lab-kerb lab-lane", 4: "lab-kerb" })) {
      const line = road.filter((_, i) => i % 8 === 0).map((pose) => ahead(pose, 0, Number(left))).map(({ x, y }) => `${x.toFixed(1)},${y.toFixed(1)}`);
      world.append(svg("path", { class: name, d: `M${line.join("L")}` }));
    }
    const object = ({ x, y }) => svg("circle", { class: "lab-object", cx: x.toFixed(1), cy: y.toFixed(1), r: 0.5 });
    world.append(...objects.map(object), scans);

    const carried = ([x, y, yaw]) => `translate(${x} ${y}) rotate(${(yaw * 180) / Math.PI})`;
    const between = (a, b, share) => a.map((value, i) => value + share * (b[i] - value));
    let pair = {}; // what the radar sees in the present pair of scans

    function drawStreet(time) {
      const width = Math.min(WIDTH, street.clientWidth || WIDTH),
        height = width < 500 ? 190 : 330,
        car = Math.min(CAR, width / 5);
      street.setAttribute("viewBox", `0 0 ${width} ${height}`);
      const [x, y, yaw] = poseAt(time),
        turn = (-yaw * 180) / Math.PI;
      const camera = `translate(${car} ${height / 2}) scale(${SCALE} ${-SCALE}) rotate(${turn}) translate(${-x} ${-y})`;
      world.setAttribute("transform", camera);
      const number = Math.floor(time / CYCLE),
        first = poseAt(number * CYCLE),
        second = poseAt(number * CYCLE + HORIZON),
        phase = time - number * CYCLE;
      if (pair.number !== number) pair = { number, scans: [seenFrom(first, 2 * number), seenFrom(second, 2 * number + 1)] };
      // the second scan is laid where the first was taken, and slides to where it fits
      const slid = clamp((phase - HORIZON - 0.1) / 0.25, 0, 1) ** 0.5,
        fade = Math.min(1, (CYCLE - phase) / 0.15);
      /** A scan at a pose; its marks are upright in a world whose y points up. */
      const scan = (which, set, pose) => {
        const marks = pair.scans[which].map(({ x, y }) => {
          const mark = labs.targetMark(set, 0.7);
          mark.setAttribute("transform", `translate(${x.toFixed(2)} ${y.toFixed(2)}) scale(1 -1)`);
          return mark;
        });
        return svg("g", { transform: carried(pose), opacity: fade }, ...marks);
      };
      scans.replaceChildren(scan(0, "fixed", first));
      if (phase >= HORIZON) scans.append(scan(1, "moving", between(first, second, slid)));
      const sinceScan = phase < HORIZON ? phase : phase - HORIZON,
        end = (sign) => `${car + 16 + REACH * SCALE * Math.cos(VIEW)},${height / 2 + sign * REACH * SCALE * Math.sin(VIEW)}`;
      beam.setAttribute("d", `M${car + 16},${height / 2}L${end(-1)}A${REACH * SCALE},${REACH * SCALE} 0 0 1 ${end(1)}z`);
      beam.setAttribute("opacity", Math.max(0, 1 - sinceScan / 0.3));
      body.setAttribute("transform", `translate(${car} ${height / 2})`);
    }
    const body = svg(
      "g",
      {},
      svg("rect", { class: "lab-car", x: -16, y: -6.5, width: 32, height: 13, rx: 4 }),
      svg("path", { class: "lab-glass", d: "M3,-5L8,-4V4L3,5z" }),
    );
    street.append(beam, world, body);

    // ---- The errors -----------------------------------------------------------------------------------------------------------

    const scatter = lab.plot({
      label: "Where the car is after one second by an estimate alone, and the 95 % ellipse stated for it",
      xlabel: "too far ahead (m)",
      ylabel: "too far left (m)",
      shape: 0.82,
      narrow: 0.6,
      equal: true,
    });

    function drawErrors(shown, held) {
      scatter.extent([-0.25, 0.25], [-0.25, 0.25]);
      scatter.clear();
      for (const axis of ["x", "y"]) scatter.rule(axis, 0, "lab-zero");
      const now = shown - 1;
      if (now < 0) return;
      errors
        .slice(0, now)
        .forEach(([x, y], i) => scatter.mark("circle", x, y, 2.5, held[i] ? "lab-inside" : "lab-outside"));
      scatter.ellipse(0, 0, stated(lab.state.covariance, now), Math.sqrt(LEVEL), "lab-line lab-strong lab-robust");
      scatter.mark("circle", ...errors[now], 6, `lab-now ${held[now] ? "lab-fill-robust" : "lab-fill-none"}`);
    }

    function tell(shown, count) {
      const share = `${number((100 * count) / shown, 0)}\u00a0%`,
        counted = [html("strong", {}, `${count} of ${shown}`), ` errors, ${share}, lie in the 95\u00a0% ellipse of the `];
      const words = shown ? [...counted, `${NAMES[lab.state.covariance]}.`] : ["The ellipse should hold 95\u00a0% of the errors."];
      lab.tell(html("p", { class: "lab-outcome" }, ...words));
    }

    // ---- Playing --------------------------------------------------------------------------------------------------------------

    let playing = false,
      clock = 0; // s on the road
    const ended = () => lab.state.shown >= LAST;

    /** From where it is, or from the start if it has ended. */
    function play() {
      const from = ended() ? 0 : clock,
        end = times.at(-1);
      playing = true;
      lab.animate(
        SECONDS * (1 - from / end),
        (share) => {
          clock = from + share * (end - from);
          lab.state.shown = times.filter((time) => time <= clock).length;
          lab.update();
        },
        () => {
          playing = false;
          lab.update();
        },
      );
    }

    // what is touched ends an animation; the other covariance is looked at while the car drives on
    lab.changed = (key) => {
      if (key === "covariance") {
        if (playing) play();
        return;
      }
      playing = false;
      if (key !== "pause") clock = times[lab.state.shown - 1] ?? 0;
    };

    const button = lab.button("", () => (playing ? lab.touched("pause") : play()));
    button.classList.add("lab-go");
    const LEGEND = ["● an error inside the ellipse stated for it", "○ outside"];
    lab.controls.push(() => (button.textContent = playing ? "Pause" : "Drive"));
    lab.build(
      [
        html(
          "div",
          { class: "lab-hero" },
          html("div", {}, street),
          panel("After one second without the radar", scatter),
        ),
        lab.told,
        bar(
          button,
          lab.choice("covariance", "Covariance", { hessian: "usual", budget: "with a budget" }),
          lab.slider("shown", {
            label: "time",
            min: 0,
            max: LAST,
            step: 1,
            show: (shown) => `${number(times[shown - 1] ?? 0, 1)} s`,
          }),
        ),
        labs.legend(...labs.setKey("fixed", "moving"), ...LEGEND.map((each) => html("span", {}, each))),
      ],
      () => {
        const { shown, covariance } = lab.state,
          held = inside[covariance],
          count = held.slice(0, shown).filter(Boolean).length;
        if (!lab.result) clock = times[shown - 1] ?? 0;
        lab.result = { shown, inside: count };
        drawStreet(clock);
        drawErrors(shown, held);
        tell(shown, count);
      },
    );
  },
);
