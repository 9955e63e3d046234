// A drive on a public road, replayed: the car from above, two scans of its radar that slide onto each other, and whether the
// error of each velocity lies in the ellipse stated for it. Estimates and scans are in replay_data.js, which
// tools/replay_data.py writes and describes.
labs.define(
  "replay",
  () => ({
    shown: 0, // estimates so far
    covariance: "hessian",
  }),
  (lab) => {
    const { svg, html, fixed: number, clamp, bar, panel } = labs;
    const NAMES = { __proto__: null, hessian: "inverse Hessian", budget: "budget" };
    const LEVEL = d2d.chiSquareQuantile(0.95, 2),
      BLIND = 1; // s for which the car goes on by an estimate alone
    const column = (name) => replayData[name],
      times = column("time"),
      poses = times.map((_, i) => ["x", "y", "yaw"].map((name) => column(name)[i])),
      errors = times.map((_, i) => ["errorX", "errorY"].map((name) => BLIND * column(name)[i])),
      LAST = times.length;
    /** A covariance stated with an estimate, or their mean: `pick` takes an entry from those of all estimates. */
    const stated = (name, pick) => {
      const [xx, xy, yy] = ["XX", "XY", "YY"].map((entry) => BLIND ** 2 * pick(column(name + entry)));
      return [
        [xx, xy],
        [xy, yy],
      ];
    };
    const isInside = (name) => (error, i) => d2d.nees(error, stated(name, (values) => values[i])) <= LEVEL,
      inside = Object.fromEntries(Object.keys(NAMES).map((name) => [name, errors.map(isInside(name))]));
    lab.sound = ({ shown, covariance }) => covariance in NAMES && Number.isInteger(shown) && shown >= 0 && shown <= LAST;

    // ---- The street from above ----------------------------------------------------------------------------------------------

    const WIDTH = 720, // of the drawing, px at most; the car looks to the right
      CAR = 130,
      SCALE = 6.5, // px/m
      MOUNTING = { x: 3.86, y: 0.7, yaw: 0.436 }, // of the radar that is drawn, m and rad
      REACH = 75, // m
      VIEW = 1.05; // rad to both sides
    const scans = replayData.scans.map(([time, ...places]) => ({ time, places })), // in dm; two make a pair
      knots = [scans[0].time, ...times],
      driven = [[0, 0, 0], ...poses];

    /** The pose at a time, linear between two estimates. */
    function poseAt(time) {
      const later = knots.findIndex((each) => each > time),
        next = later < 0 ? LAST : Math.max(later, 1),
        share = clamp((time - knots[next - 1]) / (knots[next] - knots[next - 1]), 0, 1);
      return between(driven[next - 1], driven[next], share);
    }
    const between = (a, b, share) => a.map((value, i) => value + share * (b[i] - value));
    const carried = ([x, y, yaw]) => `translate(${x} ${y}) rotate(${(yaw * 180) / Math.PI})`;

    /** The targets of a scan, upright in a world whose y points up. */
    function markedScan({ places }, set) {
      const marks = places.flatMap((x, i) => {
        if (i % 2) return [];
        const mark = labs.targetMark(set, 0.45);
        mark.setAttribute("transform", `translate(${x / 10} ${places[i + 1] / 10}) scale(1 -1)`);
        return [mark];
      });
      return svg("g", {}, ...marks);
    }

    const label = "The car from above, with the targets of its radar",
      street = svg("svg", { class: "lab-street", role: "img", "aria-label": label }),
      path = svg("path", { class: "lab-lane", d: `M${driven.map(([x, y]) => `${x},${y}`).join("L")}` }),
      shown = svg("g"),
      world = svg("g", {}, path, shown),
      edge = (sign) => `${(REACH * SCALE * Math.cos(VIEW)).toFixed(1)},${(sign * REACH * SCALE * Math.sin(VIEW)).toFixed(1)}`,
      sector = `M0,0L${edge(-1)}A${REACH * SCALE},${REACH * SCALE} 0 0 1 ${edge(1)}z`,
      seat = `translate(${MOUNTING.x * SCALE} ${-MOUNTING.y * SCALE}) rotate(${(-MOUNTING.yaw * 180) / Math.PI})`,
      beam = svg("path", { class: "lab-beam", d: sector, transform: seat }),
      body = svg(
        "g",
        {},
        beam,
        svg("rect", { class: "lab-car", x: -7, y: -6.5, width: 33, height: 13, rx: 4 }),
        svg("path", { class: "lab-glass", d: "M12,-5L17,-4V4L12,5z" }),
      );
    const sight = svg("text", { class: "lab-label", x: 12 }, "blue: seen by this radar"),
      SIGNS = [["fixed", "● ", "1 a scan"], ["moving", "▲ ", "2 the next"], ["", "", "3 laid onto it"]],
      sign = ([set, mark, words]) => svg("text", { class: "lab-label" }, svg("tspan", { class: `lab-set-${set}` }, mark), words),
      phases = SIGNS.map(sign);
    street.append(body, world, sight, ...phases);
    let pair = {}; // that is shown: its number, and its two scans as they are drawn

    function drawStreet(time) {
      const width = Math.min(WIDTH, street.clientWidth || WIDTH),
        height = width < 500 ? 190 : 360,
        car = Math.min(CAR, width / 5);
      street.setAttribute("viewBox", `0 0 ${width} ${height}`);
      const [x, y, yaw] = poseAt(time),
        turn = (-yaw * 180) / Math.PI,
        place = `translate(${car} ${height / 2})`;
      world.setAttribute("transform", `${place} scale(${SCALE} ${-SCALE}) rotate(${turn}) translate(${-x} ${-y})`);
      body.setAttribute("transform", place);
      const number = Math.max(0, scans.findLastIndex((each, i) => i % 2 === 0 && each.time <= time)),
        [first, second] = [scans[number], scans[number + 1]];
      if (pair.number !== number) {
        pair = { number, first: markedScan(first, "fixed"), second: markedScan(second, "moving") };
        shown.replaceChildren(pair.first, pair.second);
      }
      // the second scan is laid where the first was taken, and slides to where it fits
      const since = Math.max(0, time - second.time),
        slid = clamp((since - 0.1) / 0.25, 0, 1) ** 0.5,
        phase = time < second.time ? 0 : slid ? 2 : 1,
        ends = scans[number + 2]?.time ?? Infinity,
        places = [first, second].map((each) => poseAt(each.time));
      pair.first.setAttribute("transform", carried(places[0]));
      pair.second.setAttribute("transform", carried(between(...places, slid)));
      pair.second.setAttribute("visibility", time < second.time ? "hidden" : "visible");
      shown.setAttribute("opacity", clamp((ends - time) / 0.15, 0, 1));
      beam.setAttribute("opacity", clamp(1 - (phase ? since : time - first.time) / 0.3, 0.3, 1));
      sight.setAttribute("y", height / 2 + 42); // where no target is
      phases.forEach((each, i) => {
        const look = { x: 12 + (i * Math.min(width, 480)) / 3.6, y: height - 12, "font-weight": i === phase ? 700 : 400 };
        for (const [name, value] of Object.entries(look)) each.setAttribute(name, value);
      });
    }

    // ---- The errors -----------------------------------------------------------------------------------------------------------

    const scatter = lab.plot({
      label: "Where the car is after one second by an estimate alone, and the 95 % ellipse stated for it",
      xlabel: "too far ahead (m)",
      ylabel: "too far left (m)",
      shape: 0.97,
      narrow: 0.6,
      equal: true,
    });

    const LOOKS = ["lab-inside", "lab-outside"]; // its ellipse

    function drawErrors(shown, held) {
      scatter.extent([-0.2, 0.2], [-0.27, 0.27]);
      scatter.clear();
      for (const axis of ["x", "y"]) scatter.rule(axis, 0, "lab-zero");
      const now = shown - 1,
        { covariance } = lab.state,
        own = labs.planar(stated(covariance, (values) => (shown ? values[now] : d2d.mean(values))));
      errors.slice(0, shown).forEach(([x, y], i) => scatter.mark("circle", x, y, 2.5, LOOKS[held[i] ? 0 : 1]));
      LOOKS.forEach((look, i) => {
        scatter.mark("circle", -0.18, 0.23 - 0.05 * i, 4, look);
        scatter.text(-0.18, 0.23 - 0.05 * i, look.slice(4), { dx: 9, dy: 4 });
      });
      scatter.ellipse(0, 0, own, Math.sqrt(LEVEL), `lab-line lab-strong lab-${covariance}`);
      scatter.text(-Math.sqrt(LEVEL * own.xx), 0, "95\u00a0%", { dx: -4, dy: -4, "text-anchor": "end" });
      if (shown) scatter.mark("circle", ...errors[now], 6, held[now] ? "lab-now" : "lab-now lab-fill-none");
    }

    function tell(count, all) {
      const share = `${number((100 * count) / all, 0)}\u00a0%`,
        ellipse = `the 95\u00a0% ellipse of the ${NAMES[lab.state.covariance]}`,
        words = [html("strong", {}, `${count} of ${all}`), ` errors, ${share}, lie in ${ellipse}.`],
        question = [html("strong", {}, "Press Drive."), ` How many of ${LAST} errors will lie in ${ellipse}?`];
      lab.tell(html("p", { class: "lab-outcome" }, ...(all ? words : question)));
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
        end - from, // as long as on the road
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
      ],
      () => {
        const { shown, covariance } = lab.state,
          held = inside[covariance],
          count = held.slice(0, shown).filter(Boolean).length;
        if (!lab.result) clock = times[shown - 1] ?? 0;
        lab.result = { shown, inside: count };
        drawStreet(clock);
        drawErrors(shown, held);
        tell(count, shown);
      },
    );
  },
);
