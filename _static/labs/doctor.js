// The covariance doctor: a table of errors and of the covariances stated for them, judged as d2d judges them, and what may be
// wrong.  The table is read in the browser and goes nowhere, not even into the page's address.
labs.define(
  "doctor",
  () => ({
    example: "scale", // empty: a table of the reader's own
  }),
  (lab) => {
    const { html, fixed: number, clamp, bar, fold, panel } = labs,
      { mean, median } = d2d;
    const MOST = 6; // errors in a row
    const SLOW = 0.2; // lag-one autocorrelation from which errors are called slow
    const WILD = (count) => 2 + 6 / Math.sqrt(count); // mean over typical square from which a few errors spoil the mean
    const ALIKE = 2, // largest over smallest factor of directions that are called alike
      RIGHT = 1.3; // factor up to which a direction is called right

    const indices = (count) => Array.from({ length: count }, (_, i) => i);
    const sum = (values) => values.reduce((a, b) => a + b, 0);
    const most = (values) => values.reduce((a, b) => Math.max(a, b), -Infinity);
    const least = (values) => values.reduce((a, b) => Math.min(a, b), Infinity);

    // ---- Reading a table ------------------------------------------------------------------------------------------------------

    /** The cells of a line; where semicolons separate them, a comma is a decimal point. */
    function cellsOf(line) {
      const cells = line.includes(";")
        ? line.replaceAll(",", ".").split(";")
        : line.split(line.includes(",") ? "," : /\s+/);
      return cells.map((cell) => cell.trim());
    }

    const unknown = (cell) => /^[-+]?(na|nan|inf|infinity)?$/i.test(cell);
    const numeric = (cell) => unknown(cell) || Number.isFinite(Number(cell));

    /** {heads, rows} of a table: rows of {at, values}, `at` being the line; an Error says what is wrong with it. */
    function rowsOf(text) {
      const lines = text
        .split(/\r?\n/)
        .map((line, i) => ({ line: line.trim(), at: i + 1 }))
        .filter(({ line }) => line && !line.startsWith("#"))
        .map(({ line, at }) => ({ at, cells: cellsOf(line) }));
      if (!lines.length) throw new Error("Paste a table, open a file, or choose an example.");
      const heads = lines[0].cells.every(numeric) ? null : lines.shift().cells;
      const width = (heads ?? lines[0].cells).length;
      const rows = lines.map(({ at, cells }) => {
        const strange = cells.find((cell) => !numeric(cell));
        if (strange !== undefined) throw new Error(`Line ${at}: “${strange}” is not a number.`);
        if (cells.length !== width) throw new Error(`Line ${at} has ${cells.length} columns, the first line ${width}.`);
        return { at, values: cells.map((cell) => (unknown(cell) ? NaN : Number(cell))) };
      });
      return { heads, rows: rows.filter(({ values }) => values.every(Number.isFinite)), left: rows.length, width };
    }

    /** The covariance in a row after its n errors: all of it, or the upper triangle row by row. */
    function matrixOf(values, { n, full }) {
      const entry = (i, j) => values[n + (full ? i * n + j : i * n - (i * (i - 1)) / 2 + j - i)];
      const own = (i, j) => (full ? 0.5 * (entry(i, j) + entry(j, i)) : entry(Math.min(i, j), Math.max(i, j)));
      return indices(n).map((i) => indices(n).map((j) => own(i, j)));
    }

    /** Whether a row's full matrix is symmetric, up to the rounding that d2d allows. */
    function isSymmetric(values, n) {
      const entry = (i, j) => values[n + i * n + j];
      const near = (i, j) => {
        const size = Math.sqrt(Math.abs(entry(i, i) * entry(j, j))) + Math.abs(entry(i, j));
        return Math.abs(entry(i, j) - entry(j, i)) <= 1e-6 * size;
      };
      return indices(n).every((i) => indices(i).every((j) => near(i, j)));
    }

    /** {names, errors, covariances, lines, left}; `left` rows hold something that is not known, and are left out. */
    function read(text) {
      const { heads, rows, left, width } = rowsOf(text);
      const sizes = indices(MOST + 1).slice(1);
      const layouts = sizes.flatMap((n) => [
        { n, full: true, width: n + n * n },
        { n, full: false, width: n + (n * (n + 1)) / 2 },
      ]);
      const fitting = layouts.filter((each) => each.width === width);
      if (!fitting.length) {
        const list = sizes.slice(1).map((n) => `${n + (n * (n + 1)) / 2} or ${n + n * n}`);
        throw new Error(
          `A row has ${width} columns. It should have 1 to ${MOST} errors and then their covariance: ` +
            `2 columns, or ${list.join(", ")}.`,
        );
      }
      // 20 columns are four errors with a full matrix, or five with a triangle
      const layout = fitting.find(({ n, full }) => !full || rows.every(({ values }) => isSymmetric(values, n)));
      if (!layout) {
        const { at } = rows.find(({ values }) => !isSymmetric(values, fitting[0].n));
        throw new Error(`Line ${at}: the covariance is not symmetric.`);
      }
      const { n } = layout;
      if (rows.length <= n) throw new Error(`${n} errors a row need more than ${n} rows.`);
      const covariances = rows.map(({ values }) => matrixOf(values, layout)),
        errors = rows.map(({ values }) => values.slice(0, n));
      const bad = rows.find((_, k) => !d2d.whiten(errors[k], covariances[k]));
      if (bad) throw new Error(`Line ${bad.at}: the covariance is not positive definite.`);
      return {
        names: indices(n).map((i) => heads?.[i] || `error ${i + 1}`),
        errors,
        covariances,
        lines: rows.map(({ at }) => at),
        left: left - rows.length,
      };
    }

    // ---- Judging it -----------------------------------------------------------------------------------------------------------

    /** Correlation of each value with the next; none if all are equal. */
    function lagOne(values) {
      const middle = mean(values),
        off = values.map((value) => value - middle);
      return sum(off.slice(1).map((each, k) => each * off[k])) / sum(off.map((each) => each * each)) || 0;
    }

    /** d2d.credibility and d2d.coverage of a table, of all its directions together and of each by itself. */
    function judge({ errors, covariances }) {
      const judged = judgedOf(errors, covariances);
      const columns = errors[0].map((_, i) => {
        const own = errors.map((error) => [error[i]]),
          stated = covariances.map((covariance) => [[covariance[i][i]]]);
        const normalised = own.map(([error], k) => error / Math.sqrt(stated[k][0][0]));
        return { ...judgedOf(own, stated), normalised, mean: mean(normalised), lagOne: lagOne(normalised) };
      });
      const whitened = errors.map((error, k) => d2d.whiten(error, covariances[k]));
      const middle = errors[0].map((_, i) => mean(whitened.map((each) => each[i])));
      return { ...judged, columns, bias: sum(middle.map((each) => each ** 2)) / middle.length };
    }

    /** What d2d says of errors and covariances, and the median of the NEES over what it should be. */
    function judgedOf(errors, covariances) {
      const n = errors[0].length,
        judged = d2d.credibility(errors, covariances);
      if (!judged) throw new Error("The errors do not span all directions: a column is zero, or follows from the others.");
      return {
        ...judged,
        coverage: d2d.coverage(judged.nees, n),
        typical: median(judged.nees) / d2d.chiSquareQuantile(0.5, n),
      };
    }

    /** Of how many independent rows the mean has the accuracy, if the correlation falls by r from row to row. */
    const independent = (count, r) => Math.max(1, r > 0 ? (count * (1 - r)) / (1 + r) : count);

    /** Where a true ANEES of n directions lies but for the tails, if errors are correlated by r: their squares are by r^2. */
    function regionOf(count, n, r, tail) {
      const freedom = n * independent(count, r * r);
      return [tail, 1 - tail].map((share) => d2d.chiSquareQuantile(share, freedom) / freedom);
    }

    /** {verdict, cause, slow, ...}: what fits the numbers. */
    function diagnose(judged) {
      const { anees, columns } = judged,
        count = judged.nees.length,
        r = most(columns.map((each) => each.lagOne));
      const slow = r > Math.max(SLOW, 3 / Math.sqrt(count)),
        region = regionOf(count, columns.length, slow ? r : 0, 0.025);
      const size = anees > region[1] ? "too small" : anees < region[0] ? "too large" : "right";
      const off = columns.map((each) => {
        const [low, high] = regionOf(count, 1, slow ? each.lagOne : 0, 0.005); // there are several
        return each.anees > Math.max(high, RIGHT) ? 1 : each.anees < Math.min(low, 1 / RIGHT) ? -1 : 0;
      });
      const cause = causeOf(judged, size, off, independent(count, slow ? r : 0));
      const verdict = size !== "right" ? size : cause === "none" ? "credible" : "right on average only";
      return { verdict, cause, off, slow, lagOne: r, region, rows: independent(count, r * r) };
    }

    /** Which trouble fits, in the order in which one hides another; `rows` are those that the mean error is worth. */
    function causeOf({ nees, anees, columns, bias }, size, off, rows) {
      const factors = columns.map((each) => each.anees),
        wild = WILD(nees.length);
      if (size !== "too large" && columns.some((each) => each.anees > wild * each.typical)) return "tails";
      const byChance = ({ mean: middle, anees: square }) => middle ** 2 < (9 * (square - middle ** 2)) / rows;
      if (size === "too small" && bias > anees / 3 && !columns.every(byChance)) return "bias";
      if (off.some(Boolean)) {
        const alike = most(factors) < ALIKE * least(factors) && off.every((each) => each === off[0]);
        return alike ? "scale" : "directions";
      }
      if (size === "right") return "none";
      return Math.abs(Math.log(anees / mean(factors))) > Math.log(RIGHT) ? "correlations" : "scale";
    }

    // ---- Words ----------------------------------------------------------------------------------------------------------------

    const listed = (parts) => (parts.length > 1 ? `${parts.slice(0, -1).join(", ")} and ${parts.at(-1)}` : parts[0]);
    const times = (factor) => number(Math.max(factor, 1 / factor), 1);

    const CAUSES = {
      none: () => "The errors are as large as stated, in every direction.",
      scale: ({ anees }, { verdict }) =>
        `All directions are ${verdict} by about the same factor: ${times(anees)} in the variance, ` +
        `${times(Math.sqrt(anees))} in the standard deviation. ` +
        "Suspect wrong noise, points that repeat each other, or a cost that is not a likelihood.",
      directions: ({ columns }, { off }, { names }) => {
        const those = (sign, word) =>
          names
            .map((name, i) => `${name} is too ${word} by a factor of ${times(columns[i].anees)}`)
            .filter((_, i) => off[i] === sign);
        const right = names.filter((_, i) => !off[i]);
        return (
          `The directions differ. In the variance ${listed([...those(1, "small"), ...those(-1, "large")])}` +
          `${right.length ? `; ${listed(right)} ${right.length > 1 ? "are" : "is"} about right` : ""}. ` +
          "Suspect a bias that all points share, which acts in one direction, or wrong noise of one kind of measurement."
        );
      },
      correlations: () =>
        "Each direction by itself is about right, but together they are not. Suspect the stated correlations.",
      tails: ({ nees, anees, typical }, _, { lines }) => {
        const worst = indices(nees.length).sort((a, b) => nees[b] - nees[a]);
        return (
          `A few large errors make the mean: it is ${number(anees, 1)} times what it should be, ` +
          `the median ${number(typical, 1)} times. Suspect wrong optima, points without a partner, or covariances that ` +
          `are right in some rows only. Look at lines ${listed(worst.slice(0, 3).map((k) => lines[k]))} first.`
        );
      },
      bias: ({ anees, bias, columns }, _, { names }) => {
        const [i] = indices(names.length).sort((a, b) => columns[b].mean ** 2 - columns[a].mean ** 2);
        return (
          `The errors are not centred: on average ${names[i]} is off by ${number(columns[i].mean, 1)} of its stated σ. ` +
          `Without this bias the ANEES would be ${number(anees - bias)}. ` +
          "Suspect what all estimates share: a mounting angle, a clock, the reference."
        );
      },
    };

    const SLOWLY = ({ lagOne, rows, region }, count) =>
      `Each error resembles the one before (lag-one autocorrelation ${number(lagOne)}): the ${count} rows say as much ` +
      `as about ${number(rows, 0)} independent ones, and the interval of the ANEES is rather ` +
      `${region.map((each) => number(each)).join(" to ")}.`;

    const numbers = html("div", {}); // in tables, below the pictures

    function tell(table, judged, found) {
      const { anees, bounds, typical, inclination, nci, coverage, columns } = judged,
        count = table.lines.length;
      const percent = (shares) => shares.map((share) => number(100 * share, 0)).join(", ");
      const size = found.verdict === "credible" ? "" : `: its ANEES is ${number(anees)}`;
      const slowly = found.slow ? ` ${SLOWLY(found, count)}` : "";
      lab.tell(
        html(
          "p",
          { class: "lab-outcome" },
          `${count} rows${table.left ? `, ${table.left} left out` : ""}. The stated covariance is `,
          html("strong", {}, found.verdict),
          `${size}. ${CAUSES[found.cause](judged, found, table)}${slowly}`,
        ),
      );
      numbers.replaceChildren(
        lab.table(
          ["all directions", "here", "expected"],
          [
            ["mean NEES per dimension (ANEES)", number(anees), bounds.map((each) => number(each)).join(" to\u00a0")],
            ["median NEES, over that of chi-square", number(typical), "1"],
            ["inclination I² (dB; above 0 is optimistic)", number(inclination, 1), "0"],
            ["noncredibility index NCI (dB)", number(nci, 1), "0"],
            ["errors inside their 50, 95, 99\u00a0% region", `${percent(coverage)}\u00a0%`, "50, 95, 99\u00a0%"],
          ],
        ),
        lab.table(
          ["each by itself", "square over variance", "mean over σ", "lag one", "inside 50, 95, 99\u00a0%"],
          columns.map((each, i) => [
            table.names[i],
            number(each.anees),
            number(each.mean),
            number(each.lagOne),
            `${percent(each.coverage)}\u00a0%`,
          ]),
        ),
      );
    }

    // ---- Pictures -------------------------------------------------------------------------------------------------------------

    const histogram = lab.plot({
      label: "Histogram of the NEES",
      xlabel: "NEES",
      ylabel: "share of rows",
      shape: 0.75,
      narrow: 0.38,
    });
    const strips = lab.plot({
      label: "Errors over their stated standard deviations, direction by direction",
      xlabel: "row by row, direction by direction",
      ylabel: "error over σ",
      shape: 0.75,
      narrow: 0.38,
      xTicks: false,
    });

    /** A name that fits into so many pixels. */
    function shortened(name, width) {
      const letters = Math.max(2, Math.floor(width / 8));
      return name.length > letters ? `${name.slice(0, letters - 1)}…` : name;
    }

    function drawStrips(columns, names) {
      const n = columns.length,
        reach = clamp(most(columns.flatMap(({ normalised }) => normalised.map(Math.abs))), 4, 10);
      strips.extent([0, n], [-1.15 * reach, 1.15 * reach]);
      strips.clear();
      columns.forEach(({ normalised }, i) => {
        // one path of round dots: thousands of circles would be slow
        const dots = normalised.map((each, k) => {
          const x = strips.X(i + (k + 0.5) / normalised.length),
            y = strips.Y(clamp(each, -1.1 * reach, 1.1 * reach));
          return `M${x.toFixed(1)},${y.toFixed(1)}h0`;
        });
        strips.add(labs.svg("path", { class: "lab-dots", d: dots.join("") }));
        if (i) strips.rule("x", i, "lab-zero");
        strips.text(i + 0.5, strips.y[1], shortened(names[i], strips.w / n), { dy: 14, "text-anchor": "middle" });
      });
      const bound = Math.sqrt(d2d.chiSquareQuantile(0.95, 1));
      for (const side of [-bound, bound]) strips.rule("y", side, "lab-truth");
    }

    // ---- Examples -------------------------------------------------------------------------------------------------------------

    const EXAMPLES = {
      __proto__: null,
      right: "nothing wrong",
      scale: "one factor",
      direction: "one direction",
      tails: "a few wild errors",
      bias: "a bias",
      slow: "slow errors",
    };
    const ROOT = [
      [0.2, 0, 0],
      [0.1, 0.3, 0],
      [0.005, -0.01, 0.02],
    ]; // m, m, rad: the Cholesky factor of an example's covariance

    /** A table of 300 rows with one trouble, as text. */
    function example(trouble) {
      const noise = d2d.normals(11),
        draw = () => ROOT.map(noise);
      let before = draw();
      const rows = indices(300).map((k) => {
        const size = Math.exp(0.3 * noise()),
          now = draw();
        const white = trouble === "slow" ? now.map((each, i) => 0.9 * before[i] + Math.sqrt(1 - 0.9 ** 2) * each) : now;
        before = white;
        const factor = trouble === "scale" ? 2 : trouble === "tails" && k % 25 === 7 ? 9 : 1;
        const error = ROOT.map((row) => factor * size * sum(row.map((each, i) => each * white[i])));
        if (trouble === "direction") error[1] *= 3;
        if (trouble === "bias") error[0] += 0.4;
        const upper = ROOT.flatMap((row, i) =>
          ROOT.slice(i).map((other) => size ** 2 * sum(row.map((each, j) => each * other[j]))),
        );
        return [...error, ...upper].map((each) => Number(each.toPrecision(4))).join(", ");
      });
      return ["x, y, yaw, xx, xy, xyaw, yy, yyaw, yawyaw", ...rows].join("\n");
    }

    // ---- The page -------------------------------------------------------------------------------------------------------------

    const hint = html(
      "p",
      { id: `${lab.id}-hint` },
      "In each row first the errors (estimate minus truth), one to six of them, then their covariance: all of it, or the upper " +
        "triangle row by row. Commas, semicolons, tabs or blanks separate; the first line may name the columns. " +
        "All stays in your browser.",
    );
    const box = html("textarea", {
      class: "lab-table-text",
      id: `${lab.id}-table`,
      "aria-describedby": hint.id,
      rows: 4,
      spellcheck: "false",
      autocomplete: "off",
      wrap: "off",
    });
    const file = html("input", { type: "file", id: `${lab.id}-file`, accept: ".csv,.tsv,.txt,text/*" });

    let filled = ""; // the example that the box holds

    function own() {
      lab.state.example = filled = "";
      lab.touched("table");
    }

    async function open([chosen]) {
      if (!chosen) return;
      box.value = await chosen.text();
      own();
    }

    box.addEventListener("input", own);
    file.addEventListener("change", () => open(file.files));
    box.addEventListener("dragover", (event) => event.preventDefault());
    box.addEventListener("drop", (event) => {
      const { files } = event.dataTransfer;
      if (!files.length) return; // text, which the box takes by itself
      event.preventDefault();
      open(files);
    });

    lab.sound = ({ example: name }) => name in EXAMPLES;
    let judgedText = null;

    /** Read and judge what is in the box, once. */
    function ready() {
      if (box.value === judgedText) return;
      judgedText = box.value;
      try {
        const table = read(box.value),
          judged = judge(table);
        lab.result = { table, judged, found: diagnose(judged) };
      } catch (error) {
        lab.result = { error: error.message };
      }
    }

    const entry = fold(
      "Your own table: paste it, or open a file",
      html("p", { class: "lab-title" }, html("label", { for: box.id }, "Errors and covariances")),
      box,
      hint,
      bar(html("label", { for: file.id }, "or open a file, or drop it above"), file),
    );
    lab.build(
      [
        bar(lab.choice("example", "Example", EXAMPLES), entry),
        lab.told,
        labs.row(panel("NEES of all rows", histogram), panel("Errors over their stated σ", strips)),
        labs.legend(
          html("span", {}, "dashed: the chi-square density, and the lines between which 95\u00a0% should lie"),
        ),
        fold("All numbers", numbers),
      ],
      () => {
        if (lab.state.example !== filled) {
          filled = lab.state.example;
          box.value = example(filled);
        }
        ready();
        const { error, table, judged, found } = lab.result;
        entry.open ||= Boolean(error);
        box.setAttribute("aria-invalid", Boolean(error));
        if (error) {
          for (const plot of lab.plots) plot.clear();
          numbers.replaceChildren();
          lab.tell(html("p", {}, html("strong", {}, error)));
          return;
        }
        histogram.histogram(judged.nees, table.names.length, "lab-fill-target");
        drawStrips(judged.columns, table.names);
        tell(table, judged, found);
      },
    );
  },
);
