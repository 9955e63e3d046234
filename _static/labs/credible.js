// "Is this covariance true?": hundreds of registrations of one scene, their errors beside the covariances that they state.
labs.define(
  "credible",
  () => ({
    cost: "likelihood",
    runs: 100,
    stated: 1, // stated over actual standard deviation of the targets
    echoes: 1, // how often the echoed target or targets are counted
    who: "one", // which are: one target, or all
    bias: 0, // m along x, of all targets of the current scan
    seed: 1,
  }),
  (lab) => {
    const { svg, html, fixed: number, bar, panel, planar, formOf, COSTS, SCENE } = labs;
    const { theta: TRUTH, sigmaRange: SIGMA_RANGE, sigmaAzimuth: SIGMA_AZIMUTH } = SCENE,
      { mean } = d2d,
      MOST = 1000;
    const inPolar = ({ x, y }) => ({ azimuth: Math.atan2(y, x), distance: Math.hypot(x, y) });
    const FIXED = labs.SCENE_TARGETS.map(inPolar);
    const MOVING = labs.SCENE_TARGETS.map((p) => inPolar(d2d.move(p, d2d.inverseMotion(TRUTH))));
    lab.sound = (state) =>
      state.cost in COSTS &&
      Number.isInteger(state.runs) &&
      state.runs >= 1 &&
      state.runs <= MOST &&
      state.stated > 0.1 &&
      state.echoes >= 1 &&
      state.echoes <= 10;

    const scatter = lab.plot({
      label: "Errors of the translation",
      xlabel: "error in x (m)",
      ylabel: "error in y (m)",
      shape: 0.75,
      narrow: 0.46,
      equal: true,
    });
    const histogram = lab.plot({
      label: "Histogram of the NEES",
      xlabel: "NEES",
      ylabel: "share of runs",
      shape: 0.75,
      narrow: 0.46,
    });

    // ---- Registrations, a few in each frame -------------------------------------------------------------------------------------

    let results = [],
      noise = null,
      made = "";

    /** One registration: fresh noise, from the truth. */
    function run() {
      const { state } = lab;
      const sigmas = [SIGMA_RANGE * state.stated, SIGMA_AZIMUTH * state.stated];
      const observe = (targets, shift) =>
        targets.map(({ distance, azimuth }, i) => {
          const target = d2d.fromPolar(distance + SIGMA_RANGE * noise(), azimuth + SIGMA_AZIMUTH * noise(), ...sigmas);
          const count = state.who === "all" || i === 3 ? state.echoes : 1; // D is in the middle of the scene
          return { ...target, x: target.x + shift, count };
        });
      const problem = {
        fixed: observe(FIXED, 0),
        moving: observe(MOVING, state.bias),
        ...formOf(state.cost),
      };
      const found = d2d.minimise(problem, TRUTH);
      return {
        problem,
        theta: found.theta,
        error: found.theta.map((each, i) => each - TRUTH[i]),
        covariance: found.covariance,
      };
    }

    /** Begin again where anything but the number of runs changed; the noise stays the same, so that pictures compare. */
    function ready() {
      const { runs, ...rest } = lab.state,
        now = JSON.stringify(rest);
      if (now !== made) {
        made = now;
        results = [];
        noise = d2d.normals(lab.state.seed);
      }
      results.length = Math.min(results.length, runs);
      const began = performance.now();
      while (results.length < runs && performance.now() - began < 12) results.push(run());
      if (results.length < runs) lab.update();
    }

    // ---- Pictures ---------------------------------------------------------------------------------------------------------------

    const [CHI2, CHI3] = [2, 3].map((n) => d2d.chiSquareQuantile(0.95, n));

    function draw() {
      line.setAttribute("class", `lab-line lab-strong lab-${lab.state.cost}`);
      ready();
      const good = results.filter((result) => result.covariance);
      const errors = good.map((result) => result.error),
        covariances = good.map((result) => result.covariance);
      const judged = good.length > 3 ? d2d.credibility(errors, covariances) : null;
      lab.result = { results, judged };
      const own = good.map((result, k) => (judged ? judged.nees[k] : d2d.nees(result.error, result.covariance)));
      drawScatter(errors, covariances, own, judged);
      histogram.histogram(own, 3, `lab-fill-${lab.state.cost}`);
      histogram.rule("x", CHI3, "lab-zero");
      histogram.text(CHI3 + 0.2, histogram.y[1] * 0.65, "← 95 %");
      tell({ nees: own, covariances }, judged);
    }

    function drawScatter(errors, covariances, own, judged) {
      // wide enough for both ellipses, in steps, so that the axes do not move with every run
      const matrices = judged ? [...covariances, judged.actual] : covariances,
        widest = 2.45 * Math.sqrt(Math.max(0, ...matrices.map((each) => Math.max(each[0][0], each[1][1]))));
      const size = [0.4, 0.75, 1.5, 3, 6].find((each) => each > 0.9 * widest) ?? 12;
      scatter.extent([-size, size], [-size, size]);
      scatter.clear();
      for (const axis of ["x", "y"]) scatter.rule(axis, 0, "lab-zero");
      errors.forEach(([x, y], k) => scatter.mark("circle", x, y, 2, own[k] <= CHI3 ? "lab-inside" : "lab-outside"));
      if (!judged) return;
      const stated = judged.actual.map((row, i) => row.map((_, j) => mean(covariances.map((each) => each[i][j])))),
        middle = judged.actual.map((_, i) => mean(errors.map((each) => each[i]))),
        spread = judged.actual.map((row, i) => row.map((each, j) => each - middle[i] * middle[j]));
      scatter.ellipse(0, 0, planar(stated), Math.sqrt(CHI2), `lab-line lab-strong lab-${lab.state.cost}`);
      scatter.ellipse(middle[0], middle[1], planar(spread), Math.sqrt(CHI2), "lab-truth lab-strong");
      scatter.mark("cross", middle[0], middle[1], 6, "lab-ink lab-strong");
    }

    function tell(own, judged) {
      const covered = own.nees.filter((each) => each <= CHI3).length,
        failed = results.length - own.nees.length;
      const pair = (of) => [0, 1].map((i) => number(of(i))).join(",\u00a0");
      if (!judged) return lab.tell(html("p", {}, `${results.length} registrations so far.`));
      const { anees, bounds, inclination } = judged;
      const verdict = anees > bounds[1] ? "too small" : anees < bounds[0] ? "too large" : "credible";
      const size =
        verdict === "credible" ? "" : ` by a factor of ${number(anees > 1 ? anees : 1 / anees, 1)} in the variance`;
      lab.tell(
        html(
          "p",
          {},
          labs.inlineMark(lab.state.cost),
          ` ${results.length} registrations: the stated covariance is `,
          html("strong", {}, verdict),
          `${size}.`,
          failed ? ` ${failed} did not converge and are left out.` : "",
        ),
        lab.table(
          ["", "here", "expected"],
          [
            ["mean NEES per dimension (ANEES)", number(anees), `${number(bounds[0])} to\u00a0${number(bounds[1])}`],
            ["errors inside their own 95 % region", `${number((100 * covered) / own.nees.length, 0)} %`, "95 %"],
            ["inclination I² (dB; above 0 is optimistic)", number(inclination, 1), "0"],
            [
              "root mean square error in x, y (m)",
              pair((i) => Math.sqrt(judged.actual[i][i])),
              pair((i) => Math.sqrt(mean(own.covariances.map((each) => each[i][i])))),
            ],
          ],
        ),
      );
    }

    const key = (name, text) =>
      html(
        "span",
        {},
        svg(
          "svg",
          { class: "lab-key-line", viewBox: "0 0 28 10", "aria-hidden": "true" },
          svg("path", { d: "M1,5H27", class: name }),
        ),
        ` ${text}`,
      );
    const stated = key("lab-line lab-strong", "stated 95 % ellipse"),
      line = stated.querySelector("path");
    // the noise of another generator: the same but for chance
    lab.python = () => {
      const { cost, runs, stated, echoes, who, bias } = lab.state;
      const column = (targets, name) => labs.list(targets.map((target) => target[name]));
      const counted = FIXED.map((_, i) => (who === "all" || i === 3 ? echoes : 1));
      const sigmas = [SIGMA_RANGE, SIGMA_AZIMUTH].map((sigma) => labs.short(sigma * stated));
      return labs.script(
        "rng = np.random.default_rng(0)",
        `echo = np.repeat(range(${FIXED.length}), ${labs.list(counted)})`,
        "def observed(ranges, azimuths):",
        `    noisy = [value + sigma * rng.standard_normal((${runs}, ${FIXED.length}))`,
        `             for value, sigma in ((ranges, ${SIGMA_RANGE}), (azimuths, ${SIGMA_AZIMUTH}))]`,
        `    return PointSet.from_polar(*(value[:, echo] for value in noisy), ${sigmas.join(", ")})`,
        "",
        `previous = observed(${column(FIXED, "distance")},`,
        `                    ${column(FIXED, "azimuth")})`,
        `current = observed(${column(MOVING, "distance")},`,
        `                   ${column(MOVING, "azimuth")})`,
        ...(bias ? [`current = PointSet(current.means + [${bias}, 0], current.covariances)`] : []),
        `truth = [${TRUTH[0]}, ${TRUTH[1]}, np.deg2rad(15)]`,
        `estimate = register(previous, current, ${labs.costOf(formOf(cost))}, truth)`,
        "good = estimate.converged",
        "judged = credibility((estimate.theta - truth)[good], estimate.covariance[good])",
        'print(f"ANEES {judged.anees:.2f}, with other noise")',
      );
    };

    lab.build(
      [
        bar(lab.costs()),
        labs.row(panel("Errors of the registrations", scatter), panel("Errors in stated units", histogram)),
        labs.legend(
          stated,
          key("lab-truth", "95 % ellipse of the errors, about their mean (+); expected histogram"),
          labs.keyOf(labs.mark("circle", 0, 0, 5, { class: "lab-inside" }), "inside its own 95 % region"),
          labs.keyOf(labs.mark("circle", 0, 0, 5, { class: "lab-outside" }), "outside"),
        ),
        bar(
          lab.button("100 more registrations", () => {
            lab.state.runs = Math.min(MOST, lab.state.runs + 100);
            lab.touched("runs");
          }),
          lab.next("Other noise", "seed"),
          ...lab.tools(),
        ),
        bar(
          lab.slider("stated", {
            label: "stated over actual σ",
            min: 0.3,
            max: 3,
            step: 0.05,
            show: (v) => number(v),
          }),
          lab.slider("bias", { label: "shared bias in x", min: 0, max: 1, step: 0.02, show: (v) => `${number(v)} m` }),
          lab.choice("who", "Count", { one: "target D", all: "every target" }),
          lab.slider("echoes", {
            label: "how often",
            min: 1,
            max: 6,
            step: 1,
            show: (v) => (v === 1 ? "once" : `${v} times`),
          }),
        ),
      ],
      draw,
    );
  },
);
