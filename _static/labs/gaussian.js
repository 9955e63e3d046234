// A Gaussian to drag: its mean, its axes, the ellipse that holds 95 % of it, and how far a point is from it.
labs.define(
  "gaussian",
  () => ({
    mx: 0, // m: the mean
    my: 0,
    long: 2, // m: the standard deviations along both axes
    short: 0.5,
    turn: 30, // deg, of the first axis
    px: 1.73, // m: the point
    py: 1,
    seed: 1,
  }),
  (lab) => {
    const { svg, html, fixed: number, clamp, range, bar } = labs;
    const DEGREE = Math.PI / 180,
      EDGE = Math.sqrt(d2d.chiSquareQuantile(0.95, 2)),
      DRAWS = 400;
    lab.sound = (state) => state.long >= 0.1 && state.short >= 0.1;

    const plot = lab.plot({
      label: "A Gaussian in the plane",
      xlabel: "x (m)",
      ylabel: "y (m)",
      shape: 0.55,
      narrow: 0.9,
      equal: true,
    });

    /** From the axes of the ellipse to the plane, with the mean as origin. */
    const turned = (a, b, angle = lab.state.turn * DEGREE) => [
      a * Math.cos(angle) - b * Math.sin(angle),
      a * Math.sin(angle) + b * Math.cos(angle),
    ];
    /** A place in standard deviations along both axes. */
    function whitened(x, y) {
      const { mx, my, long, short, turn } = lab.state,
        [a, b] = turned(x - mx, y - my, -turn * DEGREE);
      return [a / long, b / short];
    }

    /** The end of an axis on the ellipse: it stretches its axis, and turns both. */
    const end = (key, name, quarter) =>
      plot.handle({
        name,
        step: 0.1,
        low: -10,
        high: 10,
        draw: svg("circle", { class: "lab-turn", r: 7 }),
        get: () => {
          const { mx, my, turn } = lab.state,
            [x, y] = turned(EDGE * lab.state[key], 0, turn * DEGREE + quarter);
          return [mx + x, my + y];
        },
        set: (x, y) => {
          const { mx, my } = lab.state;
          lab.state[key] = clamp(Math.hypot(x - mx, y - my) / EDGE, 0.1, 4);
          lab.state.turn = (Math.atan2(y - my, x - mx) - quarter) / DEGREE;
        },
        say: () => `${number(lab.state[key])} m, turned by ${number(lab.state.turn, 0)} degrees`,
      });
    plot.handle({
      name: "The mean",
      low: -5,
      high: 5,
      draw: svg("path", { class: "lab-line lab-likelihood lab-strong", d: "M-8,0H8M0,-8V8" }),
      get: () => [lab.state.mx, lab.state.my],
      set: (mx, my) => Object.assign(lab.state, { mx, my }),
    });
    end("long", "First axis", 0);
    end("short", "Second axis", Math.PI / 2);
    plot.handle({
      name: "The point",
      low: -6,
      high: 6,
      draw: svg("circle", { class: "lab-knob", r: 7 }),
      get: () => [lab.state.px, lab.state.py],
      set: (px, py) => Object.assign(lab.state, { px, py }),
    });

    /** The entries of the covariance matrix. */
    function covariance() {
      const { long, short } = lab.state,
        [[ax, ay], [bx, by]] = [turned(long, 0), turned(0, short)];
      return { xx: ax * ax + bx * bx, xy: ax * ay + bx * by, yy: ay * ay + by * by };
    }

    function draw() {
      const { mx, my, long, short, px, py, seed } = lab.state,
        noise = d2d.normals(seed);
      plot.extent([-6, 6], [-4, 4]);
      plot.clear();
      let inside = 0;
      range(1, DRAWS, DRAWS).forEach(() => {
        const z = [noise(), noise()],
          [x, y] = turned(long * z[0], short * z[1]),
          within = Math.hypot(...z) <= EDGE;
        inside += within;
        plot.mark("circle", mx + x, my + y, 2, within ? "lab-inside" : "lab-outside");
      });
      plot.ellipse(mx, my, covariance(), EDGE, "lab-line lab-likelihood lab-strong");
      plot.segment(mx, my, px, py, "lab-truth");
      tell(inside);
    }

    function tell(inside) {
      const { mx, my, px, py } = lab.state,
        { xx, xy, yy } = covariance(),
        distance = Math.hypot(...whitened(px, py));
      lab.result = { distance, covariance: [xx, xy, yy] };
      lab.tell(
        html(
          "p",
          {},
          `The point is ${number(Math.hypot(px - mx, py - my))} m from the mean, which is a Mahalanobis distance of `,
          html("strong", {}, `D = ${number(distance)}`),
          `. Of all draws, ${number(100 * Math.exp((-distance * distance) / 2), 1)} % lie farther away. `,
          `The ellipse holds ${inside} of the ${DRAWS} draws shown.`,
        ),
        lab.table(
          ["", "σ₁² (m²)", "σ₂² (m²)", "σ₁₂ (m²)", "correlation ϱ"],
          [["covariance", number(xx), number(yy), number(xy), number(xy / Math.sqrt(xx * yy))]],
        ),
      );
    }

    lab.python = () => {
      const { mx, my, px, py } = lab.state,
        { xx, xy, yy } = covariance();
      return labs.script(
        `sigma = np.array([${labs.list([xx, xy])}, ${labs.list([xy, yy])}])`,
        `away = np.array(${labs.list([px, py])}) - ${labs.list([mx, my])}`,
        "distance = np.sqrt(away @ np.linalg.solve(sigma, away))",
        'print(f"D = {distance:.2f}, {100 * np.exp(-(distance**2) / 2):.1f} % lie farther away")',
      );
    };

    lab.build(
      [plot.box, bar(lab.next("Other draws", "seed"), ...lab.tools())],
      draw,
    );
  },
);
