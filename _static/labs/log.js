// The track of one's own log: choose a file, say where the sensors sit, see and download what the command line would write.
// Nothing is sent anywhere: a worker computes, and it is made from the text of the functions that the page has loaded,
// because a page that was opened from a folder may load no file into a worker.
(() => {
  "use strict";

  const FOLDER = new URL(".", document.currentScript.src);

  /** What the worker runs: it reads a log, and tracks it if there are settings. */
  function work() {
    const say = (kind, value) => postMessage({ kind, value });
    onmessage = ({ data: { bytes, source, settings } }) => {
      try {
        const log = tracker.readRows(bytes, source);
        if (!settings) {
          say("done", { columns: log.columns, sensors: log.sensors, targets: log.rows.length });
          return;
        }
        const steps = tracker.track(log, settings);
        let step = steps.next(),
          told = 0;
        for (; !step.done; step = steps.next()) {
          if (performance.now() < told + 100) continue;
          told = performance.now();
          say("share", step.value);
        }
        const { rows, sensors } = step.value,
          scans = sensors.map(({ name, scans: own }) => ({ name, scans: own.length }));
        say("done", { rows, sensors: scans, ...findings.diagnose(step.value), agreements: findings.agreements(step.value) });
      } catch (error) {
        say("wrong", error.message);
      }
    };
  }

  /** A message to a new worker: {answer, stop}.  The answer is a promise; `share` hears how much is done. */
  function inWorker(message, share = () => {}) {
    const made = Object.entries({ d2d, tracker, findings }).map(([name, { source }]) => `globalThis.${name} = (${source})();`),
      address = URL.createObjectURL(new Blob([...made, `(${work})();`], { type: "text/javascript" })),
      worker = new Worker(address);
    const answer = new Promise((resolve, reject) => {
      worker.onerror = ({ message: why }) => reject(new Error(why || "this browser allows the page no worker to compute in"));
      worker.onmessage = ({ data: { kind, value } }) => {
        if (kind === "share") share(value);
        else if (kind === "done") resolve(value);
        else reject(new Error(value));
      };
    });
    const stop = () => {
      worker.terminate();
      URL.revokeObjectURL(address);
    };
    answer.finally(stop).catch(() => {});
    worker.postMessage(message);
    return { answer, stop };
  }

  /** The example as the bytes of a file; its script is loaded when it is asked for. */
  async function exampleBytes() {
    if (!globalThis.exampleLog) {
      await new Promise((resolve, reject) => {
        const script = labs.html("script", { src: new URL("example.js", FOLDER).href });
        script.onload = resolve;
        script.onerror = () => reject(new Error("the example could not be loaded"));
        document.head.append(script);
      });
    }
    return new TextEncoder().encode(exampleLog).buffer;
  }

  // The options of the command line in its units: place in tracker.DEFAULTS, option, label, bounds.
  const SIGMAS = [
    ["sigmas.range", "--sigma-range", "range (m)", { min: 1e-9 }],
    ["sigmas.azimuth", "--sigma-azimuth", "azimuth (°)", { min: 1e-9, max: 360 }],
    ["sigmas.doppler", "--sigma-doppler", "Doppler velocity (m/s)", { min: 1e-9 }],
  ];
  const PAIRS = [
    ["horizon", "--horizon", "with the scan so long before (s); 0.3 on the road", { min: 1e-3, max: 60 }],
    ["baseline", "--baseline", "or with so many scans before", { min: 1, step: 1, required: "" }],
    ["maxInterval", "--max-interval", "longest usual time between scans (s)", { min: 1e-3, required: "" }],
  ];
  const VEHICLE = [
    ["sideSlip", "--side-slip", "σ of its sideways velocity (m/s); empty: unknown", { min: 0, max: 1e6 }],
    ["maxAcceleration", "--max-acceleration", "largest acceleration (m/s²)", { min: 1e-3, required: "" }],
    ["extent", "--extent", "σ of reflections wandering on objects (m)", { min: 0, required: "" }],
  ];
  const BUDGET = [
    ["budget.azimuth", "--budget-azimuth", "azimuth and mounting (°)", { min: 0, max: 360, required: "" }],
    ["budget.doppler", "--budget-doppler", "Doppler velocities of a scan (m/s)", { min: 0, max: 1000, required: "" }],
    ["budget.scale", "--budget-scale", "their scale (share of 1)", { min: 0, max: 1000, required: "" }],
    ["budget.lag", "--budget-lag", "time stamps (s)", { min: 0, max: 1000, required: "" }],
    ["budget.neighbours", "--budget-neighbours", "correlation length of neighbours (m)", { min: 0, max: 1000, required: "" }],
  ];
  const OPTIONS = [...SIGMAS, ...PAIRS, ...VEHICLE, ...BUDGET];
  const MOUNTING = { x: "x, forward (m)", y: "y, left (m)", yaw: "yaw (°)" };
  const EXAMPLE = { name: "example.csv", mounting: { x: 0.4, y: 0, yaw: 0 } };

  const valueAt = (settings, place) => place.split(".").reduce((part, key) => part[key], settings);

  function setAt(settings, place, value) {
    const keys = place.split("."),
      last = keys.pop();
    keys.reduce((part, key) => part[key], settings)[last] = value;
  }

  /** The command that computes the same. */
  function commandOf(file, settings) {
    const quoted = (word) => (/^[\w.+-]+$/.test(word) ? word : `'${word.replaceAll("'", "'\\''")}'`),
      words = ["python -m d2d.radar track --csv", quoted(file)];
    for (const [name, { x, y, yaw }] of Object.entries(settings.mountings)) words.push("--mounting", quoted(name), x, y, yaw);
    if (settings.degrees) words.push("--degrees");
    for (const [place, option] of OPTIONS) {
      const value = valueAt(settings, place);
      if (value !== valueAt(tracker.DEFAULTS, place)) words.push(option, value);
    }
    return words.join(" ");
  }

  labs.define(
    "log",
    () => ({}),
    (lab) => {
      const { html, svg, fixed, bar, panel } = labs;
      const DEGREE = Math.PI / 180;
      let log = null, // {name, bytes, columns, sensors}
        running = null,
        shown = null; // {rows, sensors, inliers, found, settings}

      // ---- The fields ----------------------------------------------------------------------------------------------------

      /** A number with its label, unit and all. */
      function field(label, value, bounds) {
        const input = html("input", { type: "number", step: "any", inputmode: "decimal", value, ...bounds });
        return { input, row: html("label", { class: "lab-field" }, html("span", {}, label), input) };
      }

      const group = (legend, ...rows) =>
        html("fieldset", { class: "lab-fields" }, html("legend", {}, legend), html("div", { class: "lab-grid" }, ...rows));

      const inputs = new Map(); // by their places in the settings
      const fields = (options) =>
        options.map(([place, , label, bounds]) => {
          const { input, row } = field(label, valueAt(tracker.DEFAULTS, place), bounds);
          inputs.set(place, input);
          return row;
        });

      const degrees = html("input", { type: "checkbox" }),
        places = html("div", {}), // the sensors' mountings
        sigmas = group("Standard deviations of all targets", ...fields(SIGMAS)),
        more = html(
          "details",
          { class: "lab-more" },
          html("summary", {}, "More settings: pairs of scans, vehicle, errors that targets share"),
          group("Each scan is registered", ...fields(PAIRS)),
          group("The vehicle and what it sees", ...fields(VEHICLE)),
          group("Error budget: standard deviations of errors that many targets share", ...fields(BUDGET)),
        );
      let mountings = []; // {name, x, y, yaw}, the last three inputs

      /** The fields for a log that was read. */
      function ask({ columns, sensors, targets }, mounting = {}) {
        mountings = sensors.map((name) => ({ name }));
        places.replaceChildren(
          ...mountings.map((own) => {
            const rows = Object.entries(MOUNTING).map(([key, label]) => {
              const most = key === "yaw" ? 360 : 100,
                { input, row } = field(label, mounting[key], { min: -most, max: most, required: "" });
              own[key] = input;
              return row;
            });
            return group(`Where ${own.name} sits`, ...rows);
          }),
        );
        for (const name of ["range", "azimuth", "doppler"]) {
          const input = inputs.get(`sigmas.${name}`),
            there = columns.includes(`sigma_${name}`);
          input.required = !there;
          input.placeholder = there ? "as in the file" : "";
        }
        const count = sensors.length === 1 ? "one sensor" : `${sensors.length} sensors`;
        status.textContent = `${log.name}: ${targets.toLocaleString("en")} targets of ${count}, ${sensors.join(", ")}.`;
        form.hidden = false;
      }

      function settingsOf() {
        const settings = structuredClone(tracker.DEFAULTS);
        settings.degrees = degrees.checked;
        for (const { name, x, y, yaw } of mountings) {
          settings.mountings[name] = { x: x.valueAsNumber, y: y.valueAsNumber, yaw: yaw.valueAsNumber };
        }
        for (const [place, input] of inputs) setAt(settings, place, input.value === "" ? null : input.valueAsNumber);
        return settings;
      }

      // ---- Reading and computing -----------------------------------------------------------------------------------------

      const status = html("p", { class: "lab-status", role: "status" }),
        wrong = html("p", { class: "lab-wrong", role: "alert", hidden: "" }),
        progress = html("progress", { max: 1, value: 0, "aria-label": "Share of the estimates that are done" }),
        start = html("button", { type: "submit", class: "lab-button lab-go" }, "Estimate the track"),
        stop = lab.button("Stop", () => end("Stopped: nothing was estimated.")),
        busy = html("div", { class: "lab-bar lab-busy", hidden: "" }, progress, stop);

      function complain(text) {
        wrong.hidden = !text;
        wrong.textContent = text;
      }

      function end(text) {
        running?.stop();
        running = null;
        busy.hidden = true;
        start.disabled = false;
        if (text) status.textContent = text;
      }

      /** Compute in a worker, show what is under way, and complain if it fails; the answer, or null. */
      async function compute(message, share) {
        end();
        complain("");
        const own = inWorker(message, share);
        running = own;
        busy.hidden = false;
        start.disabled = true;
        let answer = null;
        try {
          answer = await own.answer;
        } catch (error) {
          if (running === own) complain(error.message);
        }
        if (running !== own) return null;
        end();
        return answer;
      }

      async function open(name, bytes, mounting) {
        show(null);
        form.hidden = true;
        status.textContent = `Reading ${name} …`;
        progress.removeAttribute("value");
        const answer = await compute({ bytes, source: name });
        if (!answer) {
          status.textContent = "";
          return;
        }
        log = { name, bytes };
        ask(answer, mounting);
      }

      async function estimate() {
        const settings = settingsOf(),
          began = performance.now();
        show(null);
        progress.value = 0;
        status.textContent = "Estimating …";
        const answer = await compute({ bytes: log.bytes, source: log.name, settings }, (share) => {
          progress.value = share;
          status.textContent = `Estimating: ${(100 * share).toFixed(0)}% done`;
        });
        if (!answer) {
          if (!wrong.hidden) status.textContent = "";
          return;
        }
        status.textContent = `Computed in ${((performance.now() - began) / 1000).toFixed(1)} s on this machine.`;
        show({ ...answer, settings });
      }

      // ---- The results ---------------------------------------------------------------------------------------------------

      const path = lab.plot({ label: "The path", xlabel: "x (m)", ylabel: "y (m)", shape: 1, equal: true });
      const curves = [
        ["v_x forward", "m/s", 1],
        ["v_y to the left", "m/s", 1],
        ["yaw rate ω", "°/s", 1 / DEGREE],
      ].map(([name, unit, factor], axis) => {
        const plot = lab.plot({ label: name, xlabel: "time (s)", ylabel: unit, shape: 0.65 });
        return { name: `${name} (${unit}) with ±3σ`, plot, factor, axis };
      });
      const results = html("div", { hidden: "" }),
        judgement = html("div", { class: "lab-report" }), // beneath the path
        report = html("div", { class: "lab-report" });

      function show(result) {
        shown = result;
        lab.result = result;
        results.hidden = !result;
        lab.tell();
        if (!result) return;
        judgement.replaceChildren(...symptoms(), files());
        report.replaceChildren(...inPython());
        lab.tell(...summary(), sensorTable(), ...agreement());
        lab.update();
      }

      /** What was accepted, and why the rest was not. */
      function summary() {
        const { rows } = shown,
          failed = rows.filter((row) => row.reason),
          alike = new Map();
        for (const { reason } of failed) {
          const kind = reason.replace(/(?<![\^\w.])-?\d+(\.\d+)?/g, "…");
          alike.set(kind, (alike.get(kind) ?? 0) + 1);
        }
        const commonest = [...alike].sort((a, b) => b[1] - a[1]).map(([reason, count]) => `${count} × ${reason}`);
        const share = (100 * (rows.length - failed.length)) / rows.length;
        return [
          html(
            "p",
            {},
            html("strong", {}, `${rows.length} estimates`),
            ` from ${rows[0].time.toFixed(3)} s to ${rows.at(-1).time.toFixed(3)} s, ${share.toFixed(1)}% accepted`,
            failed.length ? `; not accepted: ${commonest.join(", ")}.` : ".",
          ),
          ...(rows.length >= 20 && share < 75
            ? [html("p", {}, "Does the radar see little but traffic, as one that looks aside may, or is its mounting another?")]
            : []),
        ];
      }

      const sensorTable = () =>
        lab.table(
          ["sensor", "scans", "targets that fit, median"],
          shown.sensors.map(({ name, scans }, s) => {
            const share = shown.inliers[s];
            return [name, `${scans}`, Number.isNaN(share) ? "unknown" : `${(100 * share).toFixed(0)}%`];
          }),
        );

      /** Whether each two sensors differ as much as they state. */
      function agreement() {
        const each = shown.agreements.map(({ sensors, anees }) => `${sensors} ${Number.isNaN(anees) ? "unknown" : anees.toFixed(1)}`);
        return each.length ? [html("p", {}, `ANEES of the differences between sensors (ideally 1): ${each.join(", ")}`)] : [];
      }

      /** What looks wrong, by name. */
      function symptoms() {
        const { found } = shown,
          page = lab.element.dataset.symptoms,
          rows = page ? html("a", { href: page }, "When a path looks wrong") : "When a path looks wrong";
        if (!found.length) return [html("p", { class: "lab-symptoms" }, "No symptom of a mistake was found.")];
        const sure = found.find((each) => each.sure);
        const items = found.map(({ sensor, symptom, about }) =>
          html("li", {}, sensor ? `${sensor}: ` : "", html("strong", {}, symptom), ` (${about})`),
        );
        return [
          html("p", { class: "lab-symptoms" }, "What looks wrong, by the rows of the page ", rows, ":"),
          html("ul", {}, ...items),
          ...(sure ? [html("p", {}, `The estimates are surely of no use: ${sure.symptom}. The command line would write no file.`)] : []),
        ];
      }

      /** A link that saves a text as a file. */
      const download = (name, textOf) =>
        lab.button(`Save ${name}`, () => {
          const link = html("a", { href: URL.createObjectURL(new Blob([textOf(shown.rows)])), download: name });
          link.click();
          setTimeout(() => URL.revokeObjectURL(link.href), 60_000); // some browsers read it later
        });

      const files = () =>
        shown.rows.some((row) => !row.reason)
          ? bar(download("track.tum", tracker.tumOf), download("track_velocities.txt", tracker.tableOf))
          : html("p", {}, "No estimate was accepted, so there is nothing to save.");

      /** How to get the same from the command line, and what else it does. */
      const inPython = () => [
        html("p", {}, "The same files by the command line, to a millionth:"),
        html("pre", { class: "lab-command", tabindex: "0" }, commandOf(log.name, shown.settings)),
        html(
          "p",
          {},
          "It also writes an npz file and a picture.",
        ),
      ];

      /** At most so many rows, evenly: a picture shows no more. */
      const thinned = (rows) => rows.filter((_, i) => i % Math.ceil(rows.length / 3000) === 0);

      function drawPath() {
        const poses = thinned(tracker.posesOf(shown.rows)),
          ends = (axis) => poses.reduce(([a, b], pose) => [Math.min(a, pose[axis]), Math.max(b, pose[axis])], [0, 0]),
          [x, y] = [0, 1].map(ends),
          margin = 0.05 * Math.max(x[1] - x[0], y[1] - y[0], 1);
        const around = ([low, high]) => [low - margin, high + margin];
        path.extent(around(x), around(y));
        path.clear();
        path.line(poses, "lab-robust lab-strong");
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
            outline = [...run.map((each) => at(each, 1)), ...[...run].reverse().map((each) => at(each, -1))];
          plot.add(svg("path", { class: "lab-band", d: `M${outline.join("L")}z` }));
          plot.line(
            run.map(({ x, y }) => [x, y]),
            "lab-robust",
          );
        }
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
      const take = async (chosen) => open(chosen.name, await chosen.arrayBuffer());
      file.addEventListener("change", () => file.files.length && take(file.files[0]));

      const drop = html(
        "div",
        { class: "lab-drop" },
        html("label", { for: file.id }, "Choose a log in CSV, or drop it here:"),
        file,
        lab.button("Load the example", async () => {
          try {
            await open(EXAMPLE.name, await exampleBytes(), EXAMPLE.mounting);
          } catch (error) {
            complain(error.message);
          }
        }),
        html("p", {}, "The file stays on your machine: this page computes in your browser and sends nothing."),
      );
      lab.element.addEventListener("dragover", (event) => event.preventDefault());
      lab.element.addEventListener("drop", (event) => {
        event.preventDefault();
        const [chosen] = event.dataTransfer.files;
        if (chosen) take(chosen);
      });

      const form = html(
        "form",
        { hidden: "" },
        places,
        html("p", {}, "x and y from the vehicle's origin, best the middle of the rear axle; yaw counter-clockwise from straight ahead."),
        sigmas,
        html("label", { class: "lab-check" }, degrees, " the azimuths of the file and their standard deviations are in degrees"),
        more,
        bar(start),
      );
      form.addEventListener("submit", (event) => {
        event.preventDefault();
        estimate();
      });
      form.addEventListener("invalid", ({ target }) => more.contains(target) && (more.open = true), true);

      results.append(
        html(
          "div",
          { class: "lab-row" },
          html("div", {}, panel("The path from the square to the circle", path), judgement),
          html("div", {}, ...curves.map(({ name, plot }) => panel(name, plot))),
        ),
        report,
      );
      lab.build([drop, form, busy, status, wrong], () => {
        if (!shown) return;
        drawPath();
        curves.forEach(drawCurve);
      });
      lab.element.append(results);
    },
  );
})();
