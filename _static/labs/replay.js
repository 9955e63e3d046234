// A drive on a public road, replayed: the path, the error of each velocity, and whether it lies in the ellipse stated for it.
// The estimates are in replay_data.js, which tools/replay_data.py writes and describes.
labs.define(
  "replay",
  () => ({
    shown: replayData.time.length, // estimates so far: before anybody presses the button, all of them
    covariance: "hessian",
  }),
  (lab) => {
    const { svg, html, fixed: number, bar, panel } = labs;
    const NAMES = { __proto__: null, hessian: "inverse Hessian", budget: "budget" };
    const SECONDS = 15; // that the whole drive takes, half of what it took on the road
    const LEVEL = d2d.chiSquareQuantile(0.95, 2);

    const column = (name) => replayData[name];
    const points = (x, y) => column(x).map((each, i) => [each, column(y)[i]]);
    const path = points("x", "y"),
      truth = points("trueX", "trueY"),
      errors = points("errorX", "errorY"),
      LAST = path.length;
    const stated = (name, i) => {
      const [xx, xy, yy] = ["XX", "XY", "YY"].map((entry) => column(name + entry)[i]);
      return { xx, xy, yy };
    };
    const inside = Object.fromEntries(
      Object.keys(NAMES).map((name) => [
        name,
        errors.map((error, i) => {
          const { xx, xy, yy } = stated(name, i);
          const matrix = [
            [xx, xy],
            [xy, yy],
          ];
          return d2d.nees(error, matrix) <= LEVEL;
        }),
      ]),
    );
    lab.sound = ({ shown, covariance }) =>
      covariance in NAMES && Number.isInteger(shown) && shown >= 1 && shown <= LAST;

    const map = lab.plot({ label: "The path", xlabel: "x (m)", ylabel: "y (m)", shape: 0.66, equal: true });
    const scatter = lab.plot({
      label: "Errors of the velocity",
      xlabel: "error ahead (m/s)",
      ylabel: "error to the left (m/s)",
      shape: 0.66,
    });

    const span = (values) => [Math.min(...values), Math.max(...values)];
    const padded = ([low, high]) => [low - 0.05 * (high - low), high + 0.05 * (high - low)];
    const ACROSS = padded(span([...column("x"), ...column("trueX")])),
      UP = padded(span([...column("y"), ...column("trueY")]));

    function drawMap(now) {
      map.extent(ACROSS, UP);
      map.clear();
      map.line(truth, "lab-truth");
      map.line([[0, 0], ...path.slice(0, now + 1)], "lab-robust lab-strong");
      const [x, y] = path[now],
        turn = (-180 / Math.PI) * column("yaw")[now];
      const place = `translate(${map.X(x)} ${map.Y(y)}) rotate(${turn})`;
      map.add(svg("path", { class: "lab-knob", d: "M11,0L-7,7V-7z", transform: place }));
    }

    function drawErrors(now, held) {
      scatter.extent([-0.21, 0.21], [-0.28, 0.28]);
      scatter.clear();
      for (const axis of ["x", "y"]) scatter.rule(axis, 0, "lab-zero");
      errors
        .slice(0, now)
        .forEach(([x, y], i) => scatter.mark("circle", x, y, 2.5, held[i] ? "lab-inside" : "lab-outside"));
      scatter.ellipse(0, 0, stated(lab.state.covariance, now), Math.sqrt(LEVEL), "lab-line lab-strong lab-robust");
      scatter.mark("circle", ...errors[now], 6, `lab-now ${held[now] ? "lab-fill-robust" : "lab-fill-none"}`);
    }

    function tell(shown, count) {
      lab.tell(
        html(
          "p",
          {},
          html("strong", {}, `${count} of ${shown}`),
          ` errors, ${number((100 * count) / shown, 0)}\u00a0%, lie in the 95\u00a0% ellipse of the ${NAMES[lab.state.covariance]}.`,
        ),
      );
    }

    // ---- Playing --------------------------------------------------------------------------------------------------------------

    let playing = false;

    /** From where it is, or from the start if it has ended. */
    function play() {
      const from = lab.state.shown < LAST ? lab.state.shown : 0;
      playing = true;
      lab.animate(
        SECONDS * (1 - from / LAST),
        (share) => {
          lab.state.shown = Math.max(1, Math.round(from + share * (LAST - from)));
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
      if (playing && key === "covariance") play();
      else playing = false;
    };

    const button = lab.button("", () => (playing ? lab.touched("pause") : play()));
    lab.controls.push(() => (button.textContent = playing ? "Pause" : "Play the drive"));
    const LEGEND = [
      "dashed: the car's odometry",
      "ellipse: should hold 95\u00a0% of the errors",
      "● inside its own ellipse, ○ outside",
    ];
    lab.build(
      [
        bar(button, lab.choice("covariance", "Covariance", NAMES)),
        lab.told, // beside the button, in the first screen also of a phone
        labs.row(
          panel("The path, from the radar alone", map),
          panel("Errors of the velocity", scatter),
        ),
        labs.legend(...LEGEND.map((each) => html("span", {}, each))),
        bar(
          lab.slider("shown", {
            label: "time",
            min: 1,
            max: LAST,
            step: 1,
            show: (shown) => `${number(column("time")[shown - 1], 1)} s`,
          }),
        ),
      ],
      () => {
        const { shown, covariance } = lab.state,
          held = inside[covariance],
          count = held.slice(0, shown).filter(Boolean).length;
        lab.result = { shown, inside: count };
        drawMap(shown - 1);
        drawErrors(shown - 1, held);
        tell(shown, count);
      },
    );
  },
);
