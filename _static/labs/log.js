// The track of one's own log: choose a file, say where the sensors sit, see and download what the command line would write.
// Nothing is sent anywhere: a worker computes, and it is made from the text of the functions that the page has loaded,
// because a page that was opened from a folder may load no file into a worker.
(() => {
  "use strict";

  const FOLDER = new URL(".", document.currentScript.src);

  /** What the worker runs: it tracks a log, and says how much is done. */
  function work() {
    onmessage = ({ data: { log, settings } }) => {
      try {
        const steps = tracker.track(log, settings);
        let step = steps.next();
        for (let said = 0; !step.done; step = steps.next()) {
          if (performance.now() < said + 100) continue;
          said = performance.now();
          postMessage({ share: step.value });
        }
        postMessage({ result: step.value });
      } catch (error) {
        postMessage({ error: error.message });
      }
    };
  }

  /** Start a worker on a log; `hear` gets its messages.  Returns what stops it. */
  function inWorker(task, hear) {
    const scripts = Object.entries({ d2d, tracker }).map(([name, { source }]) => `globalThis.${name} = (${source})();`),
      address = URL.createObjectURL(new Blob([...scripts, `(${work})();`], { type: "text/javascript" })),
      worker = new Worker(address);
    worker.onerror = ({ message }) => hear({ error: message || "this browser allows the page no worker to compute in" });
    worker.onmessage = ({ data }) => hear(data);
    worker.postMessage(task);
    return () => {
      worker.terminate();
      URL.revokeObjectURL(address);
    };
  }

  /** The text of the example; its script is loaded when it is asked for. */
  async function exampleText() {
    if (!globalThis.exampleLog) {
      await new Promise((resolve, reject) => {
        const script = labs.html("script", { src: new URL("example.js", FOLDER).href });
        script.onload = resolve;
        script.onerror = () => reject(new Error("the example could not be loaded"));
        document.head.append(script);
      });
    }
    return exampleLog;
  }

  const EXAMPLE = { name: "example.csv", mounting: { x: 0.4, y: 0, yaw: 0 } };
  const MOUNTING = { x: "x, forward (m)", y: "y, left (m)", yaw: "yaw (°)" };
  // By the columns that a file may lack: the option of the command line and the label.
  const SIGMAS = {
    sigma_range: ["--sigma-range", "range (m)"],
    sigma_azimuth: ["--sigma-azimuth", "azimuth (°)"],
    sigma_doppler: ["--sigma-doppler", "Doppler velocity (m/s)"],
  };
  const TYPICAL = { sigma_range: 0.15, sigma_azimuth: 0.5, sigma_doppler: 0.06 }; // those of d2d/radar/readers/table.py
  const BUDGET = {
    azimuth: "azimuth and mounting (°)",
    doppler: "Doppler velocities of a scan (m/s)",
    scale: "their scale (share of 1)",
    lag: "time stamps (s)",
    neighbours: "correlation length of neighbours (m)",
  };

  /** The words of the command that computes the same, which belong together. */
  function commandOf(file, { mountings, sigmas, budget, flipped }) {
    const quoted = (word) => (/^[\w.+-]+$/.test(word) ? word : `'${word.replaceAll("'", "'\\''")}'`),
      words = ["python -m d2d.radar track", `--csv ${quoted(file)}`];
    if (flipped) words.push("--columns doppler=-doppler");
    for (const [name, { x, y, yaw }] of Object.entries(mountings)) words.push(`--mounting ${quoted(name)} ${x} ${y} ${yaw}`);
    for (const [name, sigma] of Object.entries(sigmas)) words.push(`${SIGMAS[name][0]} ${sigma}`);
    for (const [name, value] of Object.entries(budget)) if (value) words.push(`--budget-${name} ${value}`);
    return words;
  }

  labs.define(
    "log",
    () => ({}),
    (lab) => {
      const { html, svg, fixed, bar, panel } = labs;
      const DEGREE = Math.PI / 180;
      let log = null, // as tracker.readLog gives it
        stop = () => {},
        flipped = false, // whether the Doppler velocities have the opposite sign of the file's
        shown = null; // {rows, doubts, settings}

      // ---- The fields ----------------------------------------------------------------------------------------------------

      /** Inputs of numbers under a legend, by the keys of their labels; they are put into `inputs`. */
      function fields(legend, inputs, labels, bounds, values = {}) {
        const rows = Object.entries(labels).map(([key, label]) => {
          const attributes = { type: "number", step: "any", inputmode: "decimal", required: "", value: values[key] };
          inputs[key] = html("input", { ...attributes, ...bounds(key) });
          return html("label", { class: "lab-field" }, html("span", {}, label), inputs[key]);
        });
        return html("fieldset", { class: "lab-fields" }, html("legend", {}, legend), html("div", { class: "lab-grid" }, ...rows));
      }

      const numbers = (inputs) =>
        Object.fromEntries(Object.entries(inputs).map(([key, input]) => [key, input.valueAsNumber]));

      let mountings = {}, // inputs by the sensors' names and then by x, y, yaw
        sigmas = {};
      const budget = {},
        asked = html("div", {}),
        more = labs.fold(
          "Error budget: what many targets share",
          fields("Standard deviations", budget, BUDGET, () => ({ min: 0, max: 1000 }), tracker.DEFAULTS.budget),
        );

      /** Ask what the log does not say. */
      function ask(mounting) {
        mountings = {};
        sigmas = {};
        const most = (key) => (key === "yaw" ? 360 : 100),
          lacking = Object.entries(SIGMAS).filter(([name]) => !log.columns.includes(name)),
          labels = Object.fromEntries(lacking.map(([name, [, label]]) => [name, label]));
        asked.replaceChildren(
          ...log.sensors.map(({ name }) => {
            mountings[name] = {};
            const bounds = (key) => ({ min: -most(key), max: most(key) });
            return fields(`Where the sensor “${name}” sits`, mountings[name], MOUNTING, bounds, mounting);
          }),
          ...(mounting ? [] : [html("div", { class: "lab-car-plan" }, panel("Or drag each radar to its place, and turn it by its ring", car))]),
          ...(lacking.length ? [fields("Standard deviations of all targets", sigmas, labels, () => ({ min: 1e-9 }))] : []),
          ...(lacking.length ? [lab.button("Use typical values", typical)] : []),
        );
        placeHandles();
        const names = log.sensors.map(({ name }) => name).join(", ");
        status.textContent = `${log.source}: targets of ${names}, ${log.targets.toLocaleString("en")} in all.`;
        form.hidden = false;
      }

      const typical = () => Object.entries(sigmas).forEach(([name, input]) => (input.value = TYPICAL[name]));

      // A vehicle from above, with its radars to drag: the fields follow, and the picture follows the fields.
      const car = lab.plot({ label: "The vehicle from above", xlabel: "x (m), forward", ylabel: "y (m), left", shape: 0.5, equal: true });
      const placeOf = (inputs) => ["x", "y", "yaw"].map((key) => inputs[key].valueAsNumber || 0);
      const ARM = 1; // m from a radar to its ring

      function placeHandles() {
        car.front.replaceChildren();
        car.handles = [];
        for (const [name, inputs] of Object.entries(mountings)) {
          const put = (key, value) => (inputs[key].value = Number(value.toFixed(2)));
          const looks = { x: 10, y: -8, class: "lab-label" };
          car.handle({
            name: `The radar ${name}`,
            step: 0.05,
            draw: [labs.mark("square", 0, 0, 6, { class: "lab-fill-likelihood" }), svg("text", looks, name)],
            get: () => placeOf(inputs),
            set: (x, y) => (put("x", x), put("y", y)),
          });
          car.handle({
            name: `The direction of ${name}`,
            step: 0.02,
            draw: svg("circle", { class: "lab-turn", r: 7 }),
            get: () => {
              const [x, y, yaw] = placeOf(inputs);
              return [x + ARM * Math.cos(yaw * DEGREE), y + ARM * Math.sin(yaw * DEGREE)];
            },
            say: () => `${fixed(placeOf(inputs)[2], 0)} degrees`,
            set: (toX, toY) => {
              const [x, y] = placeOf(inputs);
              put("yaw", Math.atan2(toY - y, toX - x) / DEGREE);
            },
          });
        }
        asked.oninput = () => lab.update();
        lab.update();
      }

      function drawCar() {
        car.extent([-2, 5], [-1.75, 1.75]);
        car.clear();
        const side = [-0.9, 3.2, 3.7].map((x, i) => [x, i < 2 ? 0.9 : 0.6]); // m, from the rear axle
        car.line([...side, ...side.toReversed().map(([x, y]) => [x, -y]), side[0]], "lab-line");
        car.mark("cross", 0, 0, 6, "lab-ink");
        car.text(0, -0.6, "rear axle", { "text-anchor": "middle" });
        for (const [x, y, yaw] of Object.values(mountings).map(placeOf)) {
          car.segment(x, y, x + ARM * Math.cos(yaw * DEGREE), y + ARM * Math.sin(yaw * DEGREE), "lab-ink lab-strong");
        }
      }

      const settings = () => ({
        flipped,
        mountings: Object.fromEntries(Object.entries(mountings).map(([name, inputs]) => [name, numbers(inputs)])),
        sigmas: numbers(sigmas),
        budget: numbers(budget),
      });

      // ---- Reading and computing -----------------------------------------------------------------------------------------

      const status = html("p", { class: "lab-status", role: "status" }),
        wrong = html("p", { class: "lab-wrong", role: "alert", hidden: "" }),
        progress = html("progress", { max: 1, value: 0, "aria-label": "Share of the estimates that are done" }),
        start = html("button", { type: "submit", class: "lab-button lab-go" }, "Estimate the track"),
        busy = html(
          "div",
          { class: "lab-bar lab-busy", hidden: "" },
          progress,
          lab.button("Stop", () => end("Stopped: nothing was estimated.")),
        );

      /** End what is being computed, and say why. */
      function end(text, complaint = "") {
        stop();
        busy.hidden = true;
        start.disabled = false;
        status.textContent = text;
        wrong.hidden = !complaint;
        wrong.textContent = complaint;
      }

      /** Read a log and ask for what it does not say; what is wrong with it is shown. */
      async function open(name, textOf, mounting) {
        end(`Reading ${name} …`);
        show(null);
        form.hidden = true;
        flipped = false;
        try {
          log = tracker.readLog(await textOf(), name);
          ask(mounting);
          if (mounting) estimate(); // nothing is left to ask
        } catch (error) {
          end("", error.message);
        }
      }

      function estimate() {
        const task = { log, settings: settings() },
          began = performance.now();
        end("Estimating …");
        show(null);
        progress.value = 0;
        busy.hidden = false;
        start.disabled = true;
        stop = inWorker(task, ({ share, error, result }) => {
          if (error) end("", error);
          else if (result) {
            end(`Computed in ${((performance.now() - began) / 1000).toFixed(1)} s on this machine.`);
            show({ ...result, settings: task.settings });
          } else {
            progress.value = share;
            status.textContent = `Estimating: ${fixed(100 * share, 0)}\u00a0% done`;
          }
        });
      }

      // ---- The results ---------------------------------------------------------------------------------------------------

      const path = lab.plot({ label: "The path", xlabel: "x (m)", ylabel: "y (m)", shape: 1, equal: true });
      const curves = [
        ["Velocity ahead", "m/s", 1],
        ["Velocity to the left", "m/s", 1],
        ["Yaw rate", "°/s", 1 / DEGREE],
      ].map(([name, unit, factor], axis) => {
        const plot = lab.plot({ label: name, xlabel: "time (s)", ylabel: unit, shape: 0.65 });
        return { title: `${name} (${unit}) with ±3σ`, plot, factor, axis };
      });
      const view = lab.plot({ label: "The scan at that time", xlabel: "x (m), ahead", ylabel: "y (m), left", shape: 0.8, equal: true });
      const instant = html("input", { type: "range", min: 0, value: 0, "aria-label": "Time of the scan", oninput: () => lab.update() }),
        when = html("output", {});
      const results = html("div", { class: "lab-results", hidden: "" }),
        report = html("div", { class: "lab-report" });

      function show(result) {
        shown = result;
        lab.result = result;
        results.hidden = !result;
        setup.firstChild.hidden = !result;
        setup.open = !result;
        lab.tell(result ? [verdict(), ...doubts()] : []);
        if (!result) return;
        report.replaceChildren(bar(download("track.tum", tracker.tumOf), download("track.csv", tracker.csvOf)), ...command());
        instant.max = result.rows.length - 1;
        lab.update();
        requestAnimationFrame(() => lab.element.scrollIntoView()); // once the pictures are drawn and have their heights
      }

      /** A reason in the signs of print. */
      const typeset = (reason) =>
        reason.replace(/-(?=\d)/g, "−").replace(/ deg/g, "°").replace(/\^2/g, "²").replace(/%/g, "\u00a0%");

      /** The share that was accepted, and why the rest was not. */
      function verdict() {
        const { rows } = shown,
          failed = rows.filter((row) => row.reason),
          share = 1 - failed.length / rows.length,
          supported = tracker.supportOf(rows),
          looks = supported < 1 / 3 ? "bad" : supported > 0.9 && !shown.doubts.length ? "good" : "fair",
          good = "The path looks right. Not yet tested: whether its error bars are.",
          words = { good, fair: "Look twice at this path.", bad: "Do not use this path." },
          kinds = Map.groupBy(failed, ({ reason }) => reason.replace(/-?\d.*/, "")),
          reasons = [...kinds.values()]
            .sort((a, b) => b.length - a.length)
            .map((alike) => `${alike.length} (${alike.length > 1 ? "first: " : ""}${typeset(alike[0].reason)})`);
        return html(
          "p",
          { class: `lab-verdict lab-${looks}` },
          html("strong", {}, words[looks]),
          ` ${fixed(100 * share, 1)}\u00a0% of ${rows.length} estimates accepted`,
          `, in a row for ${fixed(100 * supported, 0)}\u00a0% of the time`,
          reasons.length ? `; refused: ${reasons.join(", ")}.` : ".",
        );
      }

      /** What the text of the log shows, and where more is said. */
      function doubts() {
        const page = lab.element.dataset.symptoms,
          name = "When a path looks wrong",
          more = html("p", {}, "Does the path look wrong? See ", page ? html("a", { href: page }, name) : name, ".");
        return [...shown.doubts.map((doubt) => html("p", { class: "lab-doubt" }, doubt, ...cure(doubt))), more];
      }

      /** A button that mends what a doubt is about, where that is one number or sign, and estimates anew. */
      function cure(doubt) {
        const turned = doubt.match(/ at (-?\d+)° from straight ahead/),
          inputs = mountings[doubt.split(": ")[0]];
        if (turned && inputs) {
          const yaw = inputs.yaw.valueAsNumber - Number(turned[1]);
          return [" ", lab.button(`Set its yaw to ${fixed(yaw, 0)}° and run again`, () => ((inputs.yaw.value = yaw), estimate()))];
        }
        return /backwards/.test(doubt) ? [" ", lab.button("Flip the sign and run again", flip)] : [];
      }

      function flip() {
        flipped = !flipped;
        for (const { scans } of log.sensors) for (const { targets } of scans) for (const each of targets) each.doppler *= -1;
        estimate();
      }

      /** Save a text as a file. */
      function save(name, text) {
        const link = html("a", { href: URL.createObjectURL(new Blob([text])), download: name });
        link.click();
        setTimeout(() => URL.revokeObjectURL(link.href), 60_000); // some browsers read it later
      }
      const download = (name, textOf) => lab.button(`Save ${name}`, () => save(name, textOf(shown.rows)));

      /** How to get the same from the command line, and what else it does. */
      const command = () => [
        html("p", {}, "The same numbers by the command line:"),
        html(
          "pre",
          { class: "lab-command", tabindex: "0" },
          ...commandOf(log.source, shown.settings).flatMap((words) => [html("span", {}, words), " "]),
        ),
        html(
          "p",
          {},
          "It also takes azimuths in degrees and a known side slip, finds mountings and clocks that are wrong, and draws a picture.",
        ),
      ];

      /** At most so many rows, evenly: a picture shows no more. */
      const thinned = (rows) => rows.filter((_, i) => i % Math.ceil(rows.length / 3000) === 0);

      function drawPath() {
        const poses = tracker.posesOf(shown.rows),
          line = thinned(poses),
          ends = (axis) => line.reduce(([a, b], pose) => [Math.min(a, pose[axis]), Math.max(b, pose[axis])], [0, 0]),
          [x, y] = [0, 1].map(ends),
          margin = 0.05 * Math.max(x[1] - x[0], y[1] - y[0], 1);
        const around = ([low, high]) => [low - margin, high + margin];
        path.extent(around(x), around(y));
        path.clear();
        path.line(line, "lab-robust lab-strong");
        const refused = poses.slice(1).filter((_, i) => shown.rows[i].reason);
        for (const pose of thinned(refused)) path.mark("cross", pose[0], pose[1], 3, "lab-line lab-summing");
        path.mark("square", 0, 0, 4, "lab-fill-target");
        path.mark("circle", poses.at(-1)[0], poses.at(-1)[1], 5, "lab-fill-robust");
      }

      function drawCurve({ plot, factor, axis }) {
        const first = shown.rows[0].time - shown.rows[0].interval,
          points = thinned(shown.rows).map(({ time, theta, covariance, reason }) => ({
            x: time - first,
            y: factor * theta[axis],
            half: reason ? NaN : 3 * factor * Math.sqrt(covariance[axis][axis]),
          }));
        const known = points.filter(({ half }) => half >= 0),
          low = Math.min(0, ...known.map(({ y, half }) => y - half)),
          high = Math.max(0, ...known.map(({ y, half }) => y + half)),
          margin = 0.05 * (high - low) || 1;
        plot.extent([0, points.at(-1).x], [low - margin, high + margin]);
        plot.clear();
        plot.rule("y", 0, "lab-zero");
        for (const run of runsOf(points)) {
          const at = ({ x, y, half }, side) => `${plot.X(x).toFixed(1)},${plot.Y(y + side * half).toFixed(1)}`,
            outline = [...run.map((point) => at(point, 1)), ...run.toReversed().map((point) => at(point, -1))];
          plot.add(svg("path", { class: "lab-band", d: `M${outline.join("L")}z` }));
          plot.line(
            run.map(({ x, y }) => [x, y]),
            "lab-robust",
          );
          if (run.length === 1) plot.mark("circle", run[0].x, run[0].y, 2, "lab-fill-robust");
        }
      }

      /** The scans that ended at the chosen time, in the vehicle's frame: filled where a target fits the velocity as static. */
      function drawScan() {
        const { time, theta } = shown.rows[instant.valueAsNumber],
          first = shown.rows[0].time - shown.rows[0].interval,
          [x, y] = tracker.posesOf(shown.rows)[instant.valueAsNumber + 1];
        when.textContent = `${fixed(time - first, 1)} s`;
        path.mark("circle", x, y, 6, "lab-now lab-fill-none");
        const targets = log.sensors.flatMap(({ name, scans }) => {
          const { x, y, yaw } = shown.settings.mountings[name],
            mounting = { x, y, yaw: yaw * DEGREE },
            scan = scans.findLast((each) => each.time <= time + 1e-9);
          return (scan?.targets ?? []).map((target) => {
            const { gain } = d2d.dopplerGradients(target.azimuth, mounting),
              expected = gain.reduce((sum, each, i) => sum + each * theta[i], 0),
              angle = target.azimuth + mounting.yaw,
              agrees = Math.abs(target.doppler - expected) < 0.5; // m/s
            return { x: x + target.range * Math.cos(angle), y: y + target.range * Math.sin(angle), agrees };
          });
        });
        const reach = (values) => [Math.min(-5, ...values) - 2, Math.max(5, ...values) + 2];
        view.extent(reach(targets.map((each) => each.x)), reach(targets.map((each) => each.y)));
        view.clear();
        view.mark("triangle", 0, 0, 7, "lab-line");
        for (const each of targets) view.target("moving", each.x, each.y, 4, each.agrees ? "lab-set-moving" : "lab-disagrees");
      }

      /** The points that follow each other without one that was not accepted. */
      function runsOf(points) {
        const runs = [[]];
        for (const point of points) {
          if (point.half >= 0) runs.at(-1).push(point);
          else if (runs.at(-1).length) runs.push([]);
        }
        return runs.filter((run) => run.length);
      }

      // ---- On the page ---------------------------------------------------------------------------------------------------

      const file = html("input", { type: "file", accept: ".csv,.txt,.tsv,text/csv,text/plain", id: `${lab.id}-file` });
      const take = ([chosen]) => chosen && open(chosen.name, () => chosen.text());
      file.addEventListener("change", () => take(file.files));
      lab.element.addEventListener("dragover", (event) => event.preventDefault());
      lab.element.addEventListener("drop", (event) => {
        event.preventDefault();
        take(event.dataTransfer.files);
      });

      const drop = html(
        "div",
        { class: "lab-drop" },
        bar(
          html("label", { for: file.id }, "Choose a log in CSV, or drop it here:"),
          file,
          lab.button("Load the example", () => open(EXAMPLE.name, exampleText, EXAMPLE.mounting)),
          lab.button("Save the example", async () => save(EXAMPLE.name, await exampleText())),
        ),
        html("p", {}, "A line for each target, in seconds, metres, radians and metres per second; its first line names the columns:"),
        html("pre", { class: "lab-command" }, "time,sensor,range,azimuth,doppler\n0.1,front,23.4,-0.12,-8.31"),
        html("p", {}, "The file stays on your machine: this page computes in your browser and sends nothing."),
      );

      const form = html(
        "form",
        { hidden: "" },
        asked,
        html("p", {}, "x and y from the vehicle's origin, best the middle of the rear axle; yaw counter-clockwise from straight ahead."),
        more,
        bar(start),
      );
      form.addEventListener("submit", (event) => {
        event.preventDefault();
        estimate();
      });
      form.addEventListener("invalid", ({ target }) => more.contains(target) && (more.open = true), true);

      const setup = labs.fold("Change the log or its settings", drop, form); // folded where there is a result
      setup.addEventListener("toggle", () => lab.update());
      results.append(
        labs.row(
          html(
            "div",
            {},
            panel("The path from the square; crosses: refused", path),
            html("div", { class: "lab-control" }, "scan at", instant, when),
            panel("Its targets; hollow: off the velocity by 0.5 m/s or more", view),
            report,
          ),
          html("div", {}, ...curves.map(({ title, plot }) => panel(title, plot))),
        ),
      );
      lab.build([setup, busy, status, wrong], () => {
        if (log && !form.hidden) drawCar();
        if (!shown) return;
        drawPath();
        drawScan();
        curves.forEach(drawCurve);
      });
      lab.element.append(results);
      show(null);
    },
  );
})();
