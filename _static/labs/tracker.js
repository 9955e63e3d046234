// The track of a log in the browser: what `python -m d2d.radar track` computes, step for step.  Each section names the
// module of d2d that it mirrors; tests/book/test_tracker.py compares the results with the command line's, to 1e-6.
//
// A classic script like engine.js, on which it builds; it defines one name, `tracker`.
//
// A target is {range, azimuth, doppler, sigmaRange, sigmaAzimuth, sigmaDoppler} in m, rad and m/s, a scan
// {time, targets}, a mounting {x, y, yaw} in m and rad, a sensor {name, scans, mounting}.  A velocity is
// [v_x, v_y, omega]; a matrix is an array of its rows.
globalThis.tracker = (function radarTracker() {
  "use strict";

  const DEGREE = Math.PI / 180;

  // ---- Matrices and numbers ----------------------------------------------------------------------------------------------

  const dot = (a, b) => a.reduce((sum, each, i) => sum + each * b[i], 0);
  const apply = (a, v) => a.map((row) => dot(row, v));
  const transposed = (a) => a[0].map((_, j) => a.map((row) => row[j]));
  const product = (a, b) => {
    const columns = transposed(b);
    return a.map((row) => columns.map((column) => dot(row, column)));
  };
  const sum = (...matrices) => matrices[0].map((row, i) => row.map((_, j) => matrices.reduce((s, m) => s + m[i][j], 0)));
  const scaled = (a, factor) => a.map((row) => row.map((each) => factor * each));
  const symmetric = (a) => scaled(sum(a, transposed(a)), 0.5);
  const outer = (a, b) => a.map((x) => b.map((y) => x * y));
  const filled = (rows, columns, value = 0) => Array.from({ length: rows }, () => new Array(columns).fill(value));
  const diagonal = (values) => values.map((value, i) => values.map((_, j) => (i === j ? value : 0)));
  const identity = (n) => diagonal(new Array(n).fill(1));
  const minus = (a, b) => a.map((each, i) => each - b[i]);
  const isFinite = (a) => a.every((row) => row.every(Number.isFinite));
  const mean = (values) => values.reduce((a, b) => a + b, 0) / values.length;

  function median(values) {
    const ordered = [...values].sort((a, b) => a - b),
      half = Math.floor(ordered.length / 2);
    return ordered.length % 2 ? ordered[half] : (ordered[half - 1] + ordered[half]) / 2;
  }

  /** The matrix X with A X = B, by Gaussian elimination. */
  function solve(a, b) {
    const rows = a.map((row, i) => [...row, ...b[i]]),
      n = a.length;
    for (let j = 0; j < n; j++) {
      let pivot = j;
      for (let i = j + 1; i < n; i++) if (Math.abs(rows[i][j]) > Math.abs(rows[pivot][j])) pivot = i;
      [rows[j], rows[pivot]] = [rows[pivot], rows[j]];
      for (let i = 0; i < n; i++) {
        const factor = rows[i][j] / rows[j][j];
        if (i !== j) for (let k = j; k < rows[i].length; k++) rows[i][k] -= factor * rows[j][k];
      }
    }
    return rows.map((row, i) => row.slice(n).map((each) => each / row[i]));
  }

  /** Eigenvalues of a symmetric matrix, and its eigenvectors as rows: Jacobi's rotations. */
  function eigen(a) {
    const m = a.map((row) => [...row]),
      vectors = identity(a.length);
    const turn = (u, v, c, s) => u.forEach((x, k) => ([u[k], v[k]] = [c * x - s * v[k], s * x + c * v[k]]));
    for (let sweep = 0; sweep < 30; sweep++) {
      for (let p = 0; p < a.length; p++) {
        for (let q = p + 1; q < a.length; q++) {
          if (m[p][q] === 0) continue;
          const slope = (m[q][q] - m[p][p]) / (2 * m[p][q]),
            t = (slope < 0 ? -1 : 1) / (Math.abs(slope) + Math.hypot(slope, 1)),
            c = 1 / Math.hypot(t, 1);
          turn(m[p], m[q], c, t * c);
          for (const row of m) [row[p], row[q]] = [c * row[p] - t * c * row[q], t * c * row[p] + c * row[q]];
          turn(vectors[p], vectors[q], c, t * c);
        }
      }
    }
    return { values: m.map((row, i) => row[i]), vectors };
  }

  /** The inverse without directions whose eigenvalue is below `cutoff` times the largest, and how many remain. */
  function pseudoInverse(a, cutoff) {
    const { values, vectors } = eigen(a),
      least = cutoff * Math.max(...values);
    const kept = vectors.filter((_, i) => values[i] > least),
      inverses = values.filter((value) => value > least).map((value) => 1 / value);
    const inverse = kept.reduce((total, v, i) => sum(total, scaled(outer(v, v), inverses[i])), filled(a.length, a.length));
    return { inverse, rank: kept.length };
  }

  /** The least squares solution of rows x = values, as numpy.linalg.lstsq(rows, values, rcond). */
  function leastSquares(rows, values, rcond) {
    const n = rows[0].length,
      gram = filled(n, n),
      right = new Array(n).fill(0);
    rows.forEach((row, k) => {
      for (let i = 0; i < n; i++) {
        right[i] += row[i] * values[k];
        for (let j = 0; j < n; j++) gram[i][j] += row[i] * row[j];
      }
    });
    const { inverse, rank } = pseudoInverse(gram, rcond ** 2);
    return { solution: apply(inverse, right), rank };
  }

  /** As Python's format {:g}. */
  const short = (value) => String(Number(value.toPrecision(6)));
  const seconds = (value, decimals = 3) => `${value.toFixed(decimals)} s`;
  const percent = (share) => `${(100 * share).toFixed(0)}%`;

  // ---- d2d/radar/readers/csv_log.py ----------------------------------------------------------------------------------------

  const MEASURED = ["time", "range", "azimuth", "doppler"],
    SIGMAS = ["sigma_range", "sigma_azimuth", "sigma_doppler"],
    STEP_BACK = 1; // s
  const BOUNDS = {
    time: {},
    range: { above: 0, most: 1e4, unit: "in m, ", hint: "; are these millimetres or centimetres?" },
    azimuth: {
      most: 2 * Math.PI * (1 + 1e-6),
      unit: "in radians (rad), ",
      hint: "; are these degrees? Then say so in the settings",
    },
    degrees: { most: 360, unit: "in degrees, " },
    doppler: {},
    sigma: { above: 0 },
  };

  /** The text of a file in UTF-8, in UTF-16 with its mark, or otherwise in Latin-1. */
  function decoded(bytes) {
    const [first, second] = new Uint8Array(bytes.slice(0, 2));
    if (first === 0xff && second === 0xfe) return new TextDecoder("utf-16le").decode(bytes);
    if (first === 0xfe && second === 0xff) return new TextDecoder("utf-16be").decode(bytes);
    try {
      return new TextDecoder("utf-8", { fatal: true }).decode(bytes);
    } catch {
      return new TextDecoder("latin1").decode(bytes);
    }
  }

  /** The line that names the columns, perhaps behind a #: {names, separator, line}, its number counted from 0. */
  function readHeader(lines, source) {
    for (const [line, text] of lines.entries()) {
      const count = (mark) => text.split(mark).length,
        separator = [",", ";", "\t"].reduce((best, mark) => (count(mark) > count(best) ? mark : best));
      const names = text
        .replace(/^[# ]+/, "")
        .split(separator)
        .map((word) =>
          word
            .trim()
            .replace(/^"+|"+$/g, "")
            .toLowerCase(),
        );
      if (MEASURED.every((name) => names.includes(name))) {
        const twice = [...MEASURED, ...SIGMAS, "sensor"].find((name) => names.indexOf(name) !== names.lastIndexOf(name));
        if (twice) throw new Error(`${source}, line ${line + 1}: the column '${twice}' is named twice`);
        return { names, separator, line };
      }
      if (text.trim() && !text.startsWith("#")) {
        const found = names.map((name) => `'${name}'`).join(", ");
        throw new Error(
          `${source}, line ${line + 1}: the first line must name the columns ${MEASURED.join(", ")}, but names ${found}`,
        );
      }
    }
    throw new Error(`${source} is empty: its first line must name the columns`);
  }

  /** The words of a line; a quoted one may hold separators, but no line break. */
  function wordsOf(text, separator) {
    if (!text.includes('"')) return text.split(separator);
    const words = [];
    let rest = text;
    for (;;) {
      const quoted = /^"((?:[^"]|"")*)"/.exec(rest),
        plain = quoted ? quoted[0].length : (rest + separator).indexOf(separator);
      if (rest.startsWith('"') && (!quoted || ![separator, ""].includes(rest.charAt(plain)))) {
        throw new Error("a quotation mark must be followed by another at the end of its value, on the same line");
      }
      words.push(quoted ? quoted[1].replaceAll('""', '"') : rest.slice(0, plain));
      if (plain === rest.length) return words;
      rest = rest.slice(plain + 1);
    }
  }

  /** The number that a text is to Python. */
  function number(name, text) {
    const word = text.trim();
    if (/^[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?$/i.test(word)) return Number(word);
    if (/^[+-]?(inf|infinity|nan)$/i.test(word)) return NaN; // a number to Python, which is then refused as not finite
    throw new Error(`${name} must be a number, but is '${text}'`);
  }

  /** What is wrong with a number; nothing if it is within bounds. */
  function complaint(value, { above = -Infinity, most = Infinity, unit = "", hint = "" }) {
    if (!Number.isFinite(value)) return "must be finite, but holds nan or inf";
    if (value <= above) return `must be ${above === 0 ? "positive" : `above ${above}`}, but is ${short(value)}`;
    if (Math.abs(value) > most) return `must be ${unit}at most ${short(most)}, but is ${short(value)}${hint}`;
    return "";
  }

  /** A log as its rows: {columns, rows}, each row {line, sensor, values}.  The settings decide on what they mean. */
  function readRows(bytes, source) {
    const lines = decoded(bytes).split(/\r\n|\n|\r/),
      header = readHeader(lines, source),
      columns = [...MEASURED, ...SIGMAS].filter((name) => header.names.includes(name)),
      places = columns.map((name) => header.names.indexOf(name)),
      sensorAt = header.names.indexOf("sensor");
    const rows = [];
    for (let i = header.line + 1; i < lines.length; i++) {
      try {
        const words = wordsOf(lines[i], header.separator);
        if (!words.some((word) => word.trim()) || words[0].startsWith("#")) continue;
        if (words.length !== header.names.length) {
          throw new Error(
            `there must be ${header.names.length} values as in the first line, but are ${words.length}`,
          );
        }
        const sensor = sensorAt < 0 ? "radar" : words[sensorAt].trim();
        if (!sensor) throw new Error("sensor must be a name or a number, but is empty");
        rows.push({ line: i + 1, sensor, words: places.map((place) => words[place]) });
      } catch (error) {
        throw new Error(`${source}, line ${i + 1}: ${error.message}`);
      }
    }
    if (!rows.length) throw new Error(`${source} has no line with a target`);
    return { source, columns, rows, sensors: [...new Set(rows.map((row) => row.sensor))] };
  }

  /** The scans of each sensor by its name; `sigmas` by the columns' names stand for all targets, in m, rad and m/s. */
  function loadCsv({ source, columns, rows }, { degrees = false, sigmas = {} }) {
    const missing = SIGMAS.filter((name) => !columns.includes(name) && sigmas[name] === undefined);
    if (missing.length) throw new Error(`${source} has no column ${missing.join(", ")}: give it for all targets`);
    const bounds = { ...BOUNDS, azimuth: degrees ? BOUNDS.degrees : BOUNDS.azimuth },
      radians = degrees ? DEGREE : 1;
    const used = columns.map((name, i) => [name, i]).filter(([name]) => sigmas[name] === undefined);
    const table = rows.map(({ line, words }) => {
      try {
        return { ...sigmas, ...Object.fromEntries(used.map(([name, i]) => [name, number(name, words[i])])) };
      } catch (error) {
        throw new Error(`${source}, line ${line}: ${error.message}`);
      }
    });
    table.forEach((values, k) => {
      for (const [name] of used) {
        const wrong = complaint(values[name], bounds[name] ?? bounds.sigma);
        if (wrong) throw new Error(`${source}, line ${rows[k].line}: ${name} ${wrong}`);
      }
    });
    const members = new Map(); // by the sensors' names, by the times
    rows.forEach(({ sensor }, k) => {
      const { time, range, azimuth, doppler, sigma_range, sigma_azimuth, sigma_doppler } = table[k];
      if (!members.has(sensor)) members.set(sensor, new Map());
      if (!members.get(sensor).has(time)) members.get(sensor).set(time, []);
      members.get(sensor).get(time).push({
        range,
        azimuth: radians * azimuth,
        doppler,
        sigmaRange: sigma_range,
        sigmaAzimuth: sigmas.sigma_azimuth ?? radians * sigma_azimuth,
        sigmaDoppler: sigma_doppler,
      });
    });
    return [...members].map(([name, scans]) => ({
      name,
      scans: inOrder([...scans.keys()]).map((time) => ({ time, targets: scans.get(time) })),
    }));
  }

  /** Times in the order of lines if a clock steps back once, as at midnight; otherwise sorted. */
  function inOrder(times) {
    const back = times.flatMap((time, i) => (i && time < times[i - 1] - STEP_BACK ? [i] : [])),
      cut = back.length === 1 ? back[0] : 0;
    const sorted = (part) => part.sort((a, b) => a - b);
    return [...sorted(times.slice(0, cut)), ...sorted(times.slice(cut))];
  }

  // ---- d2d/radar/scans/scan.py ---------------------------------------------------------------------------------------------

  /** The targets as Gaussians in the vehicle frame; the variance of the `extent` (m) is added along each axis. */
  function placed({ targets }, mounting, extent) {
    return targets.map(({ range, azimuth, sigmaRange, sigmaAzimuth }) => {
      const point = d2d.fromPolar(range, azimuth + mounting.yaw, sigmaRange, sigmaAzimuth);
      point.x += mounting.x;
      point.y += mounting.y;
      point.xx += extent ** 2;
      point.yy += extent ** 2;
      return point;
    });
  }

  /** Derivative of each target's position in its azimuth, m/rad. */
  const crossRange = ({ targets }, { x, y, yaw }) =>
    targets.map(({ range, azimuth }) => [-range * Math.sin(azimuth + yaw), range * Math.cos(azimuth + yaw)]);

  // ---- d2d/radar/motion/doppler.py and d2d/_kernel/consensus.py ------------------------------------------------------------

  const MAX_HYPOTHESES = 200,
    GATE = 3, // standard deviations
    MAX_FITS = 20,
    FIT_TOLERANCE = 1e-6, // m/s, m/s, rad/s
    SPARSE = 10, // targets of a sensor
    MIN_SEEN = 5, // targets that agree
    CONTRADICTING = 4, // standard deviations
    MIN_RATIO = 1e-3; // of a singular value to the largest

  /** Derivatives of the Doppler velocities in the sensor's velocity. */
  const directions = ({ targets }, { yaw }) =>
    targets.map(({ azimuth }) => [-Math.cos(azimuth + yaw), -Math.sin(azimuth + yaw)]);

  /** Which two of `size` targets give each hypothesis, spread evenly over all twos. */
  function hypotheses(size) {
    const all = (size * (size - 1)) / 2,
      count = Math.min(MAX_HYPOTHESES, all),
      step = (all - 1) / (count - 1);
    const found = [];
    let first = 0,
      end = size - 1; // of the twos of the first target
    for (let h = 0; h < count; h++) {
      const chosen = h === count - 1 ? all - 1 : Math.trunc(h * step);
      while (end <= chosen) {
        first += 1;
        end += size - 1 - first;
      }
      found.push([first, size + chosen - end]);
    }
    return found;
  }

  /** The velocity by which two targets have their Doppler velocities. */
  function velocityOfTwo(a, b, first, second) {
    const inner = a[0] * b[0] + a[1] * b[1],
      cross = a[0] * b[1] - a[1] * b[0];
    if (Math.abs(cross) > MIN_RATIO * (1 + Math.abs(inner))) {
      return [(first * b[1] - second * a[1]) / cross, (second * a[0] - first * b[0]) / cross];
    }
    const sign = inner >= 0 ? 1 : -1,
      common = (first + sign * second) / (2 * (1 + Math.abs(inner)));
    return [common * (a[0] + sign * b[0]), common * (a[1] + sign * b[1])];
  }

  /** Which targets agree with the best-supported hypothesis of a sensor's velocity; all if none do. */
  function agreeing({ targets }, sight) {
    const everyone = targets.map(() => true);
    if (targets.length <= 2) return everyone;
    const order = targets.map((_, k) => k);
    const by = (k) => [targets[k].azimuth, targets[k].doppler, targets[k].range];
    order.sort((a, b) => by(a).reduce((found, value, i) => found || value - by(b)[i], 0));
    const agrees = (k, [along, across]) => {
      const [c, s] = sight[k],
        { doppler, sigmaDoppler, sigmaAzimuth } = targets[k],
        residual = doppler - (c * along + s * across),
        turned = sigmaAzimuth * (c * across - s * along);
      return residual * residual < GATE * GATE * (sigmaDoppler * sigmaDoppler + turned * turned);
    };
    let best = [0, 0],
      most = -1;
    for (const two of hypotheses(targets.length)) {
      const [i, j] = two.map((k) => order[k]),
        velocity = velocityOfTwo(sight[i], sight[j], targets[i].doppler, targets[j].doppler);
      let count = 0;
      for (let k = 0; k < targets.length; k++) count += agrees(k, velocity);
      if (count > most) [best, most] = [velocity, count];
    }
    const found = targets.map((_, k) => agrees(k, best));
    return found.some(Boolean) ? found : everyone;
  }

  /** The velocity of a sensor along the vehicle's axes, and the derivatives over sigma of what it rests on. */
  function sensorFit(scan, mounting) {
    if (!scan.targets.length) return { velocity: [0, 0], seen: [] };
    const sight = directions(scan, mounting),
      inlying = agreeing(scan, sight),
      chosen = scan.targets.filter((_, k) => inlying[k]),
      system = sight.filter((_, k) => inlying[k]);
    const spread = Math.max(1e-6, GATE * median(scan.targets.map((target) => target.sigmaAzimuth)));
    const { solution: velocity } = leastSquares(
      system.map((row, k) => row.map((each) => each / chosen[k].sigmaDoppler)),
      chosen.map(({ doppler, sigmaDoppler }) => doppler / sigmaDoppler),
      spread,
    );
    const seen = system.map(([c, s], k) => {
      const turned = (s * velocity[0] - c * velocity[1]) * chosen[k].sigmaAzimuth,
        sigma = Math.hypot(chosen[k].sigmaDoppler, turned);
      return [c / sigma, s / sigma];
    });
    return { velocity, seen };
  }

  /** The acceleration {value, covariance} by the Doppler velocities of earlier and later scans. */
  function dopplerAcceleration(pairs, before) {
    let value = [0, 0, 0],
      covariance = before;
    for (const { previous, current, mounting, interval } of pairs) {
      const [first, second] = [previous, current].map((scan) => sensorFit(scan, mounting));
      if (Math.min(first.seen.length, second.seen.length) < MIN_SEEN) continue;
      const to = [
        [1, 0, -mounting.y],
        [0, 1, mounting.x],
      ];
      const spreads = [first, second].map(({ seen }) => pseudoInverse(product(transposed(seen), seen), 1e-6).inverse);
      const crossed = product(to, covariance),
        expected = sum(product(crossed, transposed(to)), scaled(sum(...spreads), 1 / interval ** 2)),
        gain = transposed(solve(expected, crossed));
      const difference = minus(
        minus(second.velocity, first.velocity).map((each) => each / interval),
        apply(to, value),
      );
      const away = dot(
        difference,
        solve(
          expected,
          difference.map((each) => [each]),
        ).flat(),
      );
      if (away < CONTRADICTING ** 2) {
        value = value.map((each, i) => each + dot(gain[i], difference));
        covariance = symmetric(sum(covariance, scaled(product(gain, crossed), -1)));
      }
    }
    return { value, covariance };
  }

  /** The vehicle's velocity by the Doppler velocities of several sensors: {theta, determined}. */
  function dopplerEgoMotion(views) {
    const targets = views.flatMap(({ scan, mounting }) => {
      const agree = agreeing(scan, directions(scan, mounting));
      return scan.targets.map((target, k) => ({
        ...target,
        ...d2d.dopplerGradients(target.azimuth, mounting),
        agree: agree[k],
        sigma: target.sigmaDoppler,
      }));
    });
    let theta = [0, 0, 0],
      determined = false;
    for (let fit = 0; fit < MAX_FITS && targets.some((target) => target.agree); fit++) {
      const chosen = targets.filter((target) => target.agree),
        system = chosen.map(({ gain, sigma }) => gain.map((each) => each / sigma)),
        scale = [0, 1, 2].map((i) => Math.hypot(...system.map((row) => row[i])) + 1e-300);
      const { solution, rank } = leastSquares(
        system.map((row) => row.map((each, i) => each / scale[i])),
        chosen.map(({ doppler, sigma }) => doppler / sigma),
        MIN_RATIO,
      );
      const found = solution.map((each, i) => each / scale[i]),
        moved = Math.max(...minus(theta, found).map(Math.abs));
      theta = found;
      determined = rank === 3;
      let same = true;
      const agree = targets.map((target) => {
        target.sigma = Math.hypot(target.sigmaDoppler, target.sigmaAzimuth * dot(target.slope, theta));
        const agrees = Math.abs(target.doppler - dot(target.gain, theta)) < GATE * target.sigma;
        same &&= agrees === target.agree;
        return agrees;
      });
      if (!agree.some(Boolean) || (moved < FIT_TOLERANCE && same)) break;
      targets.forEach((target, k) => (target.agree = agree[k]));
    }
    return { theta, determined };
  }

  /** Starts for a registration, near the Doppler velocities. */
  function dopplerStarts(views) {
    const alone = () => views.filter(({ scan }) => scan.targets.length).flatMap(startsAlone);
    const places = new Set(views.map(({ mounting: { x, y, yaw } }) => [x, y, yaw].join()));
    if (places.size > 1) {
      const { theta, determined } = dopplerEgoMotion(views),
        targets = views.reduce((total, { scan }) => total + scan.targets.length, 0);
      if (determined) return [theta, ...(targets < SPARSE * views.length ? alone() : [])];
    }
    return alone();
  }

  function startsAlone({ scan, mounting }) {
    const [along, across] = sensorFit(scan, mounting).velocity,
      starts = [[along, across, 0]];
    if (mounting.x !== 0) {
      const turn = across / mounting.x;
      starts.push([along + turn * mounting.y, 0, turn]);
    }
    return starts;
  }

  // ---- d2d/radar/motion/model.py, pairs.py and estimate.py -----------------------------------------------------------------

  const OUTLIER = { fraction: 0.2, xx: 100, xy: 0, yy: 100 },
    DOPPLER_WIDTH = 4; // m/s

  const pairOf = (previous, current, mounting) => {
    const interval = current.time - previous.time;
    return { previous, current, mounting, interval, middle: current.time - 0.5 * interval };
  };

  const middleOf = (pairs) => mean(pairs.map((pair) => pair.middle));

  /** One pair as the engine reads it, without the velocities gained since the common time. */
  function pairProblem({ previous, current, mounting, interval }, [byMiddle, byScan], extent) {
    const [vx, vy, turn] = byMiddle.map((each) => interval * each),
      [cosine, sine] = [Math.cos(turn), Math.sin(turn)];
    const ahead = ({ x, y }) => ({
      x: cosine * x - sine * y + vx - 0.5 * turn * vy,
      y: sine * x + cosine * y + vy + 0.5 * turn * vx,
    });
    const moving = placed(current, mounting, extent).map((point, k) => {
      const { doppler, azimuth, sigmaDoppler, sigmaAzimuth } = current.targets[k],
        measured = d2d.dopplerMeasurement(doppler, azimuth, sigmaDoppler, sigmaAzimuth, mounting);
      measured.value -= dot(measured.gain, byScan);
      return { ...point, ...ahead(point), doppler: measured };
    });
    const fixed = placed(previous, mounting, extent);
    return { fixed, moving, outlier: OUTLIER, interval, dopplerWidth: DOPPLER_WIDTH };
  }

  /** The cost of the velocity that pairs of scans share; with an acceleration, of that at the middle of the pairs. */
  function problemOf(pairs, { prior, extent }, acceleration = [0, 0, 0], near = [0, 0, 0]) {
    const time = middleOf(pairs),
      gained = (passed) => acceleration.map((each) => passed * each);
    return {
      pairs: pairs.map((pair) => {
        const byMiddle = apply(following(near, pair.interval), gained(pair.middle - time));
        return pairProblem(pair, [byMiddle, gained(pair.current.time - time)], extent);
      }),
      prior,
    };
  }

  /** The matrix of [theta, .] in SE(2). */
  const bracket = ([vx, vy, omega]) => [
    [0, -omega, vy],
    [omega, 0, -vx],
    [0, 0, 0],
  ];

  /** The small motion that follows the motion over an interval if a small twist is added to it. */
  function following(theta, interval) {
    const twist = scaled(bracket(theta), interval);
    return sum(identity(3), scaled(twist, -0.5), scaled(product(twist, twist), 1 / 6));
  }

  /** The best optimum from one of several velocities, with the mean inlier probability. */
  function estimateVelocity(problem, starts) {
    const found = starts.map((start) => d2d.minimise(problem, start));
    const best = found.reduce((a, b) => (b.converged && !(a.converged && a.value <= b.value) ? b : a));
    return { ...best, inliers: mean(best.shares) };
  }

  // ---- d2d/dense.py: how the gradient changes with each measured value -----------------------------------------------------

  // Of each near term of a target: its component, whether it is the outlier's, gamma, u, B, the gradient less the mean, v.
  const TERM = 13;

  /**
   * Of one pair, in the velocity: {fixed, moving} (3 x 2 of each target), {value, input} (3 of each moving target).  All is
   * added up in the motion's parameters, in which a pair's gradient is [-u, by angle], and turned into the velocity's last.
   */
  function crossDerivatives({ fixed, moving, interval }, theta) {
    const { motion, a, b, c, d } = d2d.exponential(...theta.map((each) => interval * each)),
      [tx, ty, phi] = motion;
    const inVelocity = ([g0, g1, g2]) =>
      [a * g0 - b * g1, b * g0 + a * g1, c * g0 + d * g1 + g2].map((each) => interval * each);
    const inMotion = ([g0, g1, g2]) => {
      const x = (a * g0 + b * g1) / (a * a + b * b),
        y = (a * g1 - b * g0) / (a * a + b * b);
      return [x, y, g2 - c * x - d * y].map((each) => each / interval);
    };
    const positionsInVelocity = (rows) => transposed(transposed(rows).map(inVelocity));
    const byFixed = fixed.map(() => filled(3, 2)),
      cross = { moving: [], value: [], input: [] },
      logs = new Float64Array(2 * fixed.length),
      terms = new Float64Array(2 * fixed.length * TERM);
    for (const target of moving) {
      const p = d2d.move(target, [0, 0, phi]),
        factor = dopplerFactor(target.doppler, theta),
        slope = inMotion(factor.gradient);
      const inlying = Math.log1p(-OUTLIER.fraction) + factor.log,
        outlying = Math.log(OUTLIER.fraction / DOPPLER_WIDTH);
      const spread = ({ xx, xy, yy }, wide) => (wide ? OUTLIER : { xx: xx + p.xx, xy: xy + p.xy, yy: yy + p.yy });
      let top = -Infinity;
      for (let n = 0; n < logs.length; n++) {
        const component = fixed[n >> 1],
          { xx, xy, yy } = spread(component, n & 1),
          dx = p.x + tx - component.x,
          dy = p.y + ty - component.y,
          determinant = xx * yy - xy * xy,
          square = (yy * dx * dx - 2 * xy * dx * dy + xx * dy * dy) / determinant;
        logs[n] = (n & 1 ? outlying : inlying) - 0.5 * (square + Math.log(determinant)) - Math.log(2 * Math.PI);
        if (logs[n] > top) top = logs[n];
      }
      let end = 0,
        total = 0,
        m0 = 0,
        m1 = 0,
        m2 = 0;
      for (let n = 0; n < logs.length; n++) {
        if (logs[n] < top - 40) continue; // such a term changes nothing
        const component = fixed[n >> 1],
          { xx, xy, yy } = spread(component, n & 1),
          determinant = xx * yy - xy * xy,
          bxx = yy / determinant,
          bxy = -xy / determinant,
          byy = xx / determinant,
          dx = p.x + tx - component.x,
          dy = p.y + ty - component.y,
          ux = bxx * dx + bxy * dy,
          uy = bxy * dx + byy * dy;
        const own = n & 1 ? 0 : 1, // S turns with the target: C_phi = [[e, h], [h, -e]]
          e = own * -2 * p.xy,
          h = own * (p.xx - p.yy),
          bentX = e * ux + h * uy,
          bentY = h * ux - e * uy;
        const byAngle = ux * (0.5 * bentX + p.y) + uy * (0.5 * bentY - p.x) - 0.5 * (e * (bxx - byy) + 2 * h * bxy);
        const gamma = Math.exp(logs[n] - top),
          g0 = own * slope[0] - ux,
          g1 = own * slope[1] - uy,
          g2 = own * slope[2] + byAngle;
        total += gamma;
        m0 += gamma * g0;
        m1 += gamma * g1;
        m2 += gamma * g2;
        terms.set([n >> 1, own, gamma, ux, uy, bxx, bxy, byy, g0, g1, g2, -p.y - bentX, p.x - bentY], end);
        end += TERM;
      }
      const moved = filled(3, 2),
        centred = [0, 0, 0];
      let share = 0;
      for (let at = 0; at < end; at += TERM) {
        const own = terms[at + 1],
          gamma = terms[at + 2] / total,
          ux = terms[at + 3],
          uy = terms[at + 4],
          bxx = terms[at + 5],
          bxy = terms[at + 6],
          byy = terms[at + 7],
          g0 = terms[at + 8] - m0 / total,
          g1 = terms[at + 9] - m1 / total,
          g2 = terms[at + 10] - m2 / total,
          vx = terms[at + 11],
          vy = terms[at + 12];
        const block = [
          gamma * (bxx + g0 * ux),
          gamma * (bxy + g0 * uy),
          gamma * (bxy + g1 * ux),
          gamma * (byy + g1 * uy),
          gamma * (bxx * vx + bxy * vy + g2 * ux),
          gamma * (bxy * vx + byy * vy + g2 * uy),
        ];
        const component = byFixed[terms[at]];
        for (let j = 0; j < 6; j++) {
          component[j >> 1][j & 1] -= block[j];
          moved[j >> 1][j & 1] += block[j];
        }
        moved[2][0] += gamma * uy; // the angle's lever depends on the target's position
        moved[2][1] -= gamma * ux;
        share += own * gamma;
        centred[0] += own * gamma * g0;
        centred[1] += own * gamma * g1;
        centred[2] += own * gamma * g2;
      }
      const cosine = Math.cos(phi),
        sine = Math.sin(phi),
        rest = inVelocity(centred);
      cross.moving.push(positionsInVelocity(moved.map(([x, y]) => [cosine * x + sine * y, cosine * y - sine * x])));
      cross.value.push(factor.cross.map((each, j) => -(share * each + rest[j] * factor.byValue)));
      cross.input.push(factor.crossInput.map((each, j) => -(share * each + rest[j] * factor.byInput)));
    }
    return { ...cross, fixed: byFixed.map(positionsInVelocity) };
  }

  /** A target's factor of its Doppler velocity, with its derivatives in velocity, value and azimuth. */
  function dopplerFactor({ value, variance, inputVariance, gain, slope }, theta) {
    const along = dot(slope, theta),
      total = variance + inputVariance * along * along,
      residual = value - dot(gain, theta),
      e = residual / total,
      byVelocity = slope.map((each) => 2 * inputVariance * along * each); // of the variance
    const cross = gain.map((each, j) => each / total + (e / total) * byVelocity[j]);
    return {
      log: -0.5 * (residual * e + Math.log(2 * Math.PI * total)),
      gradient: gain.map((each, j) => e * each + 0.5 * (e * e - 1 / total) * byVelocity[j]),
      cross,
      byValue: -e,
      crossInput: slope.map((each, j) => e * each - along * cross[j]),
      byInput: along * e,
    };
  }

  // ---- d2d/radar/motion/covariance.py and d2d/_kernel/errors.py ------------------------------------------------------------

  const REACH = 5; // correlation lengths

  const along = (position, [x, y]) => position.map((row) => row[0] * x + row[1] * y);

  function addTo(total, matrix, factor = 1) {
    for (let i = 0; i < 3; i++) for (let j = 0; j < 3; j++) total[i][j] += factor * matrix[i][j];
  }

  /** What independent errors of the targets' positions do to the gradient. */
  function addPositions(positions, points, noise) {
    positions.forEach((rows, k) => {
      const { xx, xy, yy } = points[k];
      const weighed = rows.map(([x, y]) => [x * xx + y * xy, x * xy + y * yy]);
      addTo(
        noise,
        weighed.map(([x, y]) => rows.map((row) => x * row[0] + y * row[1])),
      );
    });
  }

  /** The same of Doppler velocities and of azimuths, which turn the positions too. */
  function addMeasurements({ value, input, moving }, { targets }, slope, noise) {
    targets.forEach(({ sigmaDoppler, sigmaAzimuth }, k) => {
      const turned = along(moving[k], slope[k]);
      addTo(noise, outer(value[k], value[k]), sigmaDoppler ** 2);
      addTo(noise, outer(input[k], input[k]), sigmaAzimuth ** 2);
      addTo(noise, symmetric(outer(input[k], turned)), 2 * sigmaAzimuth ** 2);
    });
  }

  /** Symmetric root of a covariance. */
  function rootOf({ xx, xy, yy }) {
    const both = Math.sqrt(Math.max(xx * yy - xy * xy, 0)),
      total = Math.sqrt(xx + yy + 2 * both);
    return { xx: (xx + both) / total, xy: xy / total, yy: (yy + both) / total };
  }

  /** What correlated errors of neighbouring positions cause beyond independent ones. */
  function addDependence(positions, points, length, dependence) {
    const order = points.map((_, k) => k).sort((a, b) => points[a].x - points[b].x);
    const rows = order.map((k) => {
      const { xx, xy, yy } = rootOf(points[k]);
      return { ...points[k], own: positions[k].map(([x, y]) => [x * xx + y * xy, x * xy + y * yy]) };
    });
    rows.forEach((row, a) => {
      const neighbours = filled(3, 2);
      for (let b = a + 1; b < rows.length && rows[b].x - row.x < REACH * length; b++) {
        const distance = Math.hypot(rows[b].x - row.x, rows[b].y - row.y) / length;
        if (distance >= REACH) continue;
        for (let i = 0; i < 3; i++) {
          for (let axis = 0; axis < 2; axis++) neighbours[i][axis] += Math.exp(-distance) * rows[b].own[i][axis];
        }
      }
      const both = product(row.own, transposed(neighbours));
      addTo(dependence, sum(both, transposed(both)));
    });
  }

  const propagated = (inverse, noise) => symmetric(product(product(inverse, noise), inverse));

  /** Derivative of a gradient in a small motion that follows the pair's own. */
  function ofDisplacement(positions, turned, mounting) {
    const total = sum(filled(3, 2), ...positions);
    return total.map(([x, y], i) => [x, y, turned[i] - mounting.y * x + mounting.x * y]);
  }

  /** The parts of a velocity's covariance without the lag's, its delay and its lead, see `apply_budget`. */
  function applyBudget(problem, { theta, covariance }, pairs, budget, time, near) {
    const [noise, dependence, systematic, delayed, led] = Array.from({ length: 5 }, () => filled(3, 3)),
      common = middleOf(pairs);
    let relative = [0, 0, 0];
    pairs.forEach((pair, number) => {
      const { fixed, moving, interval } = problem.pairs[number],
        cross = crossDerivatives(problem.pairs[number], theta);
      const turned = [
        [pair.previous, cross.fixed, fixed],
        [pair.current, cross.moving, moving],
      ].map(([scan, positions, points]) => {
        const slope = crossRange(scan, pair.mounting);
        addPositions(positions, points, noise);
        if (points === moving) addMeasurements(cross, scan, slope, noise);
        if (budget.neighbours) addDependence(positions, points, budget.neighbours, dependence);
        return positions.reduce((total, position, k) => total.map((t, i) => t + along(position, slope[k])[i]), [0, 0, 0]);
      });
      const totalOf = (rows) => [0, 1, 2].map((i) => rows.reduce((total, row) => total + row[i], 0));
      const displaced = scaled(ofDisplacement(cross.moving, turned[1], pair.mounting), -interval);
      // (Magnus 1954): by how much a mean velocity differs from that in the middle of its interval
      const lag = sum(scaled(identity(3), pair.middle - time), scaled(bracket(theta), interval ** 2 / 12));
      addTo(delayed, product(product(displaced, following(theta, interval)), lag));
      addTo(led, product(displaced, following(near, interval)), common - pair.middle);
      const measured = product(
        transposed(cross.value),
        moving.map((target) => target.doppler.gain),
      );
      addTo(delayed, measured, pair.current.time - time);
      addTo(led, measured, common - pair.current.time);
      const predicted = totalOf(cross.input),
        azimuth = predicted.map((each, i) => budget.azimuth * (each + turned[0][i] + turned[1][i])),
        doppler = totalOf(cross.value).map((each) => budget.doppler * each);
      addTo(systematic, outer(azimuth, azimuth));
      addTo(systematic, outer(doppler, doppler));
      relative = relative.map(
        (each, i) => each + pair.current.targets.reduce((s, target, k) => s + target.doppler * cross.value[k][i], 0),
      );
    });
    addTo(systematic, outer(relative, relative), budget.scale ** 2);
    addTo(systematic, diagonal(problem.prior));
    const parts = Object.fromEntries(
      Object.entries({ noise, dependence, systematic }).map(([name, own]) => [name, propagated(covariance, own)]),
    );
    const gain = scaled(covariance, -1);
    return { parts, delay: product(gain, delayed), lead: product(gain, led) };
  }

  // ---- d2d/radar/tracks/intake.py ------------------------------------------------------------------------------------------

  const JUMP = 1, // s
    FEW = 6, // targets
    FRESH = 5; // cycles

  /** What is probably wrong, see `Finding`. */
  const finding = (symptom, sensor, number_, unit, sure, about) => ({
    symptom,
    sensor,
    number: number_,
    unit,
    sure,
    about,
  });

  /**
   * Takes the scans of sensors as they are to be used: clocks that jump are set on, one wrong stamp and targets given twice are
   * left out.  A scan that comes too early or too late waits for the next one, which shows whether the clock has jumped.
   */
  class Intake {
    constructor(names, maxInterval) {
      Object.assign(this, { names, maxInterval, found: [], told: new Set() });
      Object.assign(this, { latest: [], held: [], intervals: names.map(() => []), offsets: names.map(() => 0) });
    }

    /** What is to be used after a sensor's next scan: this one, none, or also the one before. */
    taken(sensor, scan) {
      return this.timed(sensor, scan).map((each) => {
        this.lookForRepetition(sensor, each);
        this.latest[sensor] = each;
        return this.withoutTwins(sensor, each);
      });
    }

    /** The scans of a sensor whose time is now known, with this time. */
    timed(sensor, scan) {
      const name = this.names[sensor],
        intervals = this.intervals[sensor],
        latest = this.latest[sensor]?.time,
        time = scan.time + this.offsets[sensor];
      let held = this.held[sensor];
      const twice = held && held.scan.time === scan.time;
      if (latest !== undefined && (twice || (latest - JUMP < time && time <= latest))) {
        const before = seconds(twice ? scan.time : latest - this.offsets[sensor], 6);
        throw new Error(
          `${name} must be in strictly increasing time, but a scan is at ${seconds(scan.time, 6)} after ${before}`,
        );
      }
      const longest = intervals.length ? this.gap(sensor) : Infinity,
        goesOn = latest === undefined || (latest < time && time <= latest + longest);
      delete this.held[sensor];
      if (held && (goesOn || scan.time < held.scan.time)) {
        this.tell("stamp", "the clock jumps", name, held.jump, "s", "for one scan");
        held = undefined;
      }
      if (!goesOn && !held) {
        this.held[sensor] = { scan, jump: time - latest };
        return [];
      }
      if (!goesOn) this.mend(sensor, held);
      else if (time - latest > this.maxInterval) this.tellGap(name, time - latest);
      if (latest !== undefined) intervals.push(goesOn ? time - latest : scan.time - held.scan.time);
      if (intervals.length > REMEMBERED) intervals.shift();
      return (held ? [held.scan, scan] : [scan]).map((each) => ({ ...each, time: each.time + this.offsets[sensor] }));
    }

    /** Set a sensor's clock after a jump; one ahead may be a gap. */
    mend(sensor, { scan, jump }) {
      const name = this.names[sensor];
      if (jump > this.maxInterval) this.tellGap(name, jump);
      else if (jump < 0) {
        this.tell(`jump ${this.offsets[sensor]}`, "the clock jumps", name, jump, "s", "back");
        this.offsets[sensor] = this.offsetAfter(sensor, this.latest[sensor].time - scan.time);
      }
    }

    /** A time over which no pair of scans reaches. */
    gap(sensor) {
      const intervals = this.intervals[sensor];
      return Math.max(FRESH * (intervals.length ? median(intervals) : 0), JUMP);
    }

    /** What to add after a jump: what another sensor's clock has just got, if it fits. */
    offsetAfter(sensor, back) {
      const guess = back + this.gap(sensor),
        others = this.offsets.filter((_, other) => other !== sensor);
      return others.find((known) => Math.abs(known - guess) < this.gap(sensor)) ?? guess;
    }

    tellGap(name, jump) {
      this.tell("ahead", "the clock jumps", name, jump, "s", "or a gap");
    }

    /** Say if a sensor pauses while others go on: by a gap, or a clock that jumps ahead. */
    lookForPause(sensor, times, others) {
      const intervals = this.intervals[sensor],
        cycle = intervals.length ? median(intervals) : 0,
        longest = this.offsets[sensor] === 0 ? FRESH * cycle : 1.001 * this.gap(sensor); // left by a mended jump
      for (let i = 1; i < times.length; i++) {
        const [start, end] = [times[i - 1], times[i]];
        const goOn = () => others.some((time) => time > start + cycle && time < end - cycle);
        if (end - start > longest && goOn()) this.tellGap(this.names[sensor], end - start);
      }
    }

    lookForRepetition(sensor, scan) {
      const before = this.latest[sensor];
      if (before && repeats(before, scan)) {
        this.tell("frozen", "a scan is repeated", this.names[sensor], scan.time, "s", `first at ${seconds(scan.time)}`);
      }
    }

    withoutTwins(sensor, scan) {
      const { targets } = scan;
      if (targets.length < FEW) return scan;
      const seen = new Set(),
        once = targets.filter(({ range, azimuth, doppler }) => {
          const key = `${range} ${azimuth} ${doppler}`,
            first = !seen.has(key);
          seen.add(key);
          return first;
        });
      const same = targets.length - once.length;
      if (2 * same < targets.length - 1) return scan;
      this.tell("twins", "targets are given twice", this.names[sensor], same / targets.length, "share", "one is used");
      return { ...scan, targets: once };
    }

    tell(what, symptom, name, value, unit, about) {
      if (!this.told.has(`${what} ${name}`)) this.found.push(finding(symptom, name, value, unit, false, about));
      this.told.add(`${what} ${name}`);
    }
  }

  // ---- d2d/radar/tracks/rounds.py ------------------------------------------------------------------------------------------

  const MAX_INTERVAL = 60, // s
    NO_TARGETS = "a scan without targets",
    AFTER_GAP = "the first scan after a gap",
    REPEATED = "a scan that repeats an earlier one",
    MOVING = 0.5, // m/s
    REMEMBERED = 9, // intervals
    ROUND = 1.5, // cycles
    OVERLAP = 0.5, // of the shorter span of time
    LONGER = 1.5, // times the usual interval
    PAIR_GAP = 2.5; // cycles

  /** Refuse times that are usually farther apart than `longest` s. */
  function checkIntervals({ name, scans }, longest) {
    const intervals = scans.slice(1).map((scan, i) => scan.time - scans[i].time);
    if (intervals.length && median(intervals) > longest) {
      const [first, second] = scans.map((scan) => scan.time.toFixed(6));
      throw new Error(
        `${name} must have times in seconds (s), at most ${short(longest)} apart, but ${second} comes after ${first}; ` +
          "are these milli- or microseconds?",
      );
    }
  }

  /** Refuse two sensors that have a scan in common: it would count twice. */
  function checkDistinct(sensors) {
    if (sensors.length < 2) return;
    const owners = new Map();
    for (const { name, scans } of sensors) {
      for (const { time, targets } of scans) {
        const key = [time, ...targets.flatMap(({ range, azimuth, doppler }) => [range, azimuth, doppler])].join(),
          owner = owners.get(key) ?? name;
        owners.set(key, owner);
        if (owner !== name && targets.length > 1) {
          throw new Error(
            `${owner} and ${name} must be different, but have the same scan at ${seconds(time, 6)}; ` +
              "is one sensor given twice?",
          );
        }
      }
    }
  }

  /** Refuse a sensor that has no time in common with any other; findings of those that have little. */
  function checkOverlap(sensors) {
    const spans = sensors
      .filter(({ scans }) => scans.length > 1)
      .map(({ name, scans }) => ({ name, start: scans[0].time, end: scans.at(-1).time }));
    return spans.flatMap((own) => {
      const shared = spans
        .filter((other) => other !== own)
        .map((other) => ({ other, common: Math.min(own.end, other.end) - Math.max(own.start, other.start) }));
      if (!shared.length) return [];
      const { other, common } = shared.reduce((a, b) =>
        b.common > a.common || (b.common === a.common && b.other.name > a.other.name) ? b : a,
      );
      const from = ({ name, start, end }) => `${name} has times from ${seconds(start)} to ${seconds(end)}`;
      if (common < 0) {
        throw new Error(`${from(own)}, and ${from(other)}: they do not overlap; is the clock of one another?`);
      }
      if (common >= OVERLAP * Math.min(own.end - own.start, other.end - other.start)) return [];
      const told = `only ${common.toFixed(1)} s of them overlap`;
      return [finding("the clock of a sensor is off", own.name, common, "s", false, told)];
    });
  }

  /** Whether a scan has the targets of an earlier one although the sensor moves. */
  function repeats(previous, current) {
    const first = previous.targets,
      second = current.targets;
    const alike =
      first.length === second.length &&
      second.every((target, k) => ["range", "azimuth", "doppler"].every((name) => target[name] === first[k][name]));
    return second.length > 0 && alike && median(second.map((target) => Math.abs(target.doppler))) > MOVING;
  }

  /** The latest scans of one sensor. */
  class History {
    constructor(mounting, baseline, horizon) {
      Object.assign(this, { mounting, baseline, horizon, scans: [], intervals: [] });
    }

    /** The usual time from one scan to the next; infinite while there is only one. */
    get cycle() {
      return this.intervals.length ? median(this.intervals) : Infinity;
    }

    /** Whether the sensor measures the same as before, so that the scan is to be left out. */
    repeats(scan) {
      return this.scans.length > 0 && repeats(this.scans.at(-1), scan);
    }

    /** The next scan, paired with an earlier one; null if there is none near enough. */
    paired(scan) {
      const { scans, intervals, baseline, horizon } = this;
      if (scans.length) {
        intervals.push(scan.time - scans.at(-1).time);
        if (intervals.length > REMEMBERED) intervals.shift();
        const usual = horizon ?? baseline * this.cycle,
          longest = Math.max(LONGER * usual, PAIR_GAP * this.cycle);
        while (scans.length && scan.time - scans[0].time > longest) scans.shift();
      }
      const previous = this.before(scan.time);
      scans.push(scan);
      if (horizon === null) while (scans.length > baseline) scans.shift();
      else while (scans.length > 1 && scans[1].time <= scan.time - horizon) scans.shift();
      return previous ? pairOf(previous, scan, this.mounting) : null;
    }

    /** Of the earlier scans, the one to register with. */
    before(time) {
      const { scans, baseline, horizon } = this;
      if (!scans.length || horizon === null) return scans[Math.max(scans.length - baseline, 0)];
      const away = (scan) => Number(Math.abs(scan.time - (time - horizon)).toFixed(6));
      return scans.reduce((best, scan) => (away(scan) <= away(best) ? scan : best));
    }
  }

  /** All rounds but the first: {time, interval, pairs, reason}, see `Rounds`. */
  function roundsOf(sensors, baseline, horizon) {
    const histories = sensors.map(({ mounting }) => new History(mounting, baseline, horizon)),
      found = [];
    let open = new Map(),
      start = NaN,
      last = NaN;
    const finish = () => {
      const scans = open;
      open = new Map();
      if (!scans.size) return;
      const place = (s) => [scans.get(s).time, histories[s].mounting.x, histories[s].mounting.y, histories[s].mounting.yaw];
      const order = [...scans.keys()].sort((a, b) => place(a).reduce((by, each, i) => by || each - place(b)[i], 0)),
        fresh = order.filter((s) => !histories[s].repeats(scans.get(s))),
        chosen = fresh.map((s) => ({ sensor: s, pair: histories[s].paired(scans.get(s)) })),
        time = mean(order.map((s) => scans.get(s).time)),
        interval = time - last;
      last = time;
      if (Number.isNaN(interval)) return;
      const known = chosen.filter(({ pair }) => pair),
        full = known.filter(({ pair }) => pair.previous.targets.length && pair.current.targets.length),
        seen = order.every((s) => scans.get(s).targets.length);
      found.push({
        time,
        interval,
        pairs: full.map(({ sensor, pair }) => ({ ...pair, sensor })),
        reason: fresh.length < order.length ? REPEATED : known.length || !seen ? NO_TARGETS : AFTER_GAP,
      });
    };
    const isOver = (time) =>
      Math.abs(time - start) > ROUND * Math.min(...[...open.keys()].map((sensor) => histories[sensor].cycle));
    const waiting = sensors
      .flatMap(({ scans }, s) => scans.map((scan) => ({ s, scan })))
      .sort((a, b) => a.scan.time - b.scan.time || a.s - b.s);
    for (let i = 0; i < waiting.length; ) {
      let end = i + 1;
      while (end < waiting.length && waiting[end].scan.time === waiting[i].scan.time) end += 1;
      // of equal times, those of sensors that the open round already holds come first: they end it
      const ending = new Set(open.keys()),
        together = waiting.slice(i, end).sort((a, b) => ending.has(b.s) - ending.has(a.s));
      for (const { s, scan } of together) {
        if (open.size && (open.has(s) || isOver(scan.time))) finish();
        if (!open.size) start = scan.time;
        open.set(s, scan);
        if (open.size === sensors.length) finish();
      }
      i = end;
    }
    finish();
    return found;
  }

  // ---- d2d/radar/tracks/limits.py ------------------------------------------------------------------------------------------

  const HARD = 0.5, // s
    BEYOND = 3; // standard deviations
  const LIMITS = {
    speed: 100,
    yawRate: 3,
    acceleration: 12,
    yawAcceleration: 1.5,
    uncertainty: 0.12,
    speedUncertainty: 0.4,
    yawRateOfSlip: 0.15,
  };

  const sigmasOf = (covariance) => covariance.map((row, i) => Math.sqrt(row[i]));

  /** What a state {time, theta, covariance} exceeds, in words; empty if it is plausible after the last one. */
  function exceeded(limits, { time, theta, covariance }, last) {
    const sigmas = sigmasOf(covariance),
      speed = Math.hypot(theta[0], theta[1]),
      turn = Math.abs(theta[2]),
      widest = Math.max(sigmas[0], sigmas[1]);
    if (speed > limits.speed + BEYOND * Math.hypot(sigmas[0], sigmas[1])) return `a speed of ${speed.toFixed(1)} m/s`;
    if (turn > limits.yawRate + BEYOND * sigmas[2]) return `a yaw rate of ${(turn / DEGREE).toFixed(1)} deg/s`;
    if (sigmas[2] > limits.uncertainty) return `a yaw rate with a sigma of ${(sigmas[2] / DEGREE).toFixed(1)} deg/s`;
    if (widest > limits.speedUncertainty) return `a velocity with a sigma of ${widest.toFixed(1)} m/s`;
    if (Math.abs((theta[1] * covariance[1][2]) / covariance[1][1]) > limits.yawRateOfSlip) {
      return `a side slip of ${theta[1].toFixed(2)} m/s`;
    }
    if (!last) return "";
    const interval = time - last.time,
      enough = Math.min(interval, Math.sqrt(interval * HARD)),
      before = sigmasOf(last.covariance);
    const axes = [
      [limits.acceleration, "an acceleration", "m/s^2 along x"],
      [limits.acceleration, "an acceleration", "m/s^2 along y"],
      [limits.yawAcceleration, "a yaw acceleration", "rad/s^2"],
    ];
    for (const [axis, [limit, kind, unit]] of axes.entries()) {
      const change = Math.abs(theta[axis] - last.theta[axis]),
        spread = BEYOND * Math.hypot(sigmas[axis], before[axis]);
      if (change > limit * enough + spread) return `${kind} of ${(change / interval).toFixed(1)} ${unit}`;
    }
    return "";
  }

  // ---- d2d/radar/tracks/acceleration.py ------------------------------------------------------------------------------------

  const UNKNOWN = diagonal([1.69, 0.0081, 0.0144]), // variances of the acceleration
    JERK = [1, 0.015 ** 2, 0.025 ** 2], // variances per s
    MANNERS = [0, 1, 10], // of driving, times JERK
    SHARES = [0.45, 0.45, 0.1], // of the time
    LASTING = 600, // s, for which a manner lasts on average
    FORGOTTEN = 2, // s
    JUMPING = 12; // standard deviations

  /** Learns the acceleration from one estimate after the other; begins anew after a gap. */
  class AccelerationFilter {
    /** Share and state {value, covariance} of [theta, a] of each manner at a time; null if it is to begin anew. */
    predicted(time) {
      const passed = time - this.time;
      if (!this.states || passed > FORGOTTEN) return null;
      const lasts = Math.exp(-passed / LASTING),
        shares = this.shares.map((share, i) => lasts * share + (1 - lasts) * SHARES[i]),
        states = MANNERS.map((manner, i) => {
          const changes = (1 - lasts) * SHARES[i],
            origins = this.shares.map((share, k) => (share * (changes + (i === k ? lasts : 0))) / shares[i]);
          return moved(merged(origins, this.states), passed, manner);
        });
      return { shares, states };
    }

    /** The acceleration {value, covariance} at a time; null if it begins anew. */
    predict(time) {
      const found = this.predicted(time);
      if (!found) return null;
      const { value, covariance } = merged(found.shares, found.states);
      return { value: value.slice(3), covariance: covariance.slice(3).map((row) => row.slice(3)) };
    }

    /** Learn from an estimate with its delay and the covariance of its errors. */
    update(time, estimate, delay, noise, by) {
      const before = this.predicted(time),
        found = before?.states.map((state) => updated(state, estimate, delay, noise)),
        jumps = found?.every(({ squares }) => squares > JUMPING ** 2);
      if (found && !jumps) {
        const most = Math.max(...found.map(({ evidence }) => evidence)),
          weights = found.map(({ evidence }, i) => before.shares[i] * Math.exp(evidence - most)),
          total = weights.reduce((all, each) => all + each, 0);
        this.states = found.map(({ state }) => state);
        this.shares = weights.map((weight) => weight / total);
      } else {
        if (jumps) by = { value: [0, 0, 0], covariance: UNKNOWN };
        const late = product(delay, by.covariance),
          own = sum(noise, product(late, transposed(delay))),
          value = [...minus(estimate, apply(delay, by.value)), ...by.value],
          covariance = [
            ...own.map((row, i) => [...row, ...late[i].map((each) => -each)]),
            ...transposed(late).map((row, i) => [...row.map((each) => -each), ...by.covariance[i]]),
          ];
        this.states = MANNERS.map(() => ({ value, covariance }));
        this.shares = SHARES;
      }
      this.time = time;
    }
  }

  /** A state after a time, in which the acceleration walks. */
  function moved({ value, covariance }, passed, manner) {
    const transition = identity(6);
    for (let i = 0; i < 3; i++) transition[i][i + 3] = passed;
    const after = product(product(transition, covariance), transposed(transition));
    JERK.forEach((usual, i) => {
      const jerk = manner * usual;
      after[i + 3][i + 3] += passed * jerk;
      after[i][i + 3] += (passed ** 2 / 2) * jerk;
      after[i + 3][i] += (passed ** 2 / 2) * jerk;
      after[i][i] += (passed ** 3 / 3) * jerk;
    });
    return { value: apply(transition, value), covariance: after };
  }

  /** Mean and covariance of a mixture of states. */
  function merged(shares, states) {
    const value = states[0].value.map((_, i) => dot(shares, states.map((state) => state.value[i]))),
      terms = states.map((state, k) => {
        const apart = minus(state.value, value);
        return scaled(sum(state.covariance, outer(apart, apart)), shares[k]);
      });
    return { value, covariance: terms.reduce((total, term) => sum(total, term)) };
  }

  /** A state after a measurement, in the form that stays definite (Joseph), and the log density that it gave it. */
  function updated({ value, covariance }, estimate, delay, noise) {
    const to = identity(3).map((row, i) => [...row, ...delay[i]]),
      crossed = product(to, covariance),
      spread = sum(product(crossed, transposed(to)), noise),
      gain = transposed(solve(spread, crossed)),
      kept = sum(identity(6), scaled(product(gain, to), -1)),
      rest = minus(estimate, apply(to, value)),
      squares = dot(rest, solve(spread, rest.map((each) => [each])).map(([each]) => each));
    return {
      state: {
        value: value.map((each, i) => each + dot(gain[i], rest)),
        covariance: sum(product(product(kept, covariance), transposed(kept)), product(product(gain, noise), transposed(gain))),
      },
      squares,
      evidence: -0.5 * (squares + eigen(spread).values.reduce((total, each) => total + Math.log(each), 0)),
    };
  }

  // ---- d2d/radar/tracks/following.py ---------------------------------------------------------------------------------------

  const MIN_EXPLAINED = 0.1,
    MIN_AGREEING = 4, // targets
    MAX_TURN = Math.PI, // rad
    WELL_EXPLAINED = 0.6;

  const isGood = (estimate) => estimate.converged && estimate.inliers >= MIN_EXPLAINED;
  const sizeOf = (pairs) => pairs.reduce((total, pair) => total + pair.current.targets.length, 0);

  /** Why an estimate is not accepted, whatever its covariance; empty if nothing is against it. */
  function doubt(estimate, pairs) {
    if (!estimate.converged) return "no optimum near the start";
    if (!isGood(estimate)) return `an optimum that rejects ${percent(1 - estimate.inliers)} of the targets`;
    const agreed = sizeOf(pairs) * estimate.inliers;
    if (agreed < MIN_AGREEING) return `an optimum that rests on ${agreed.toFixed(1)} targets`;
    const turn = Math.abs(estimate.theta[2]) * Math.max(...pairs.map((pair) => pair.interval));
    return turn > MAX_TURN ? `a turn of ${(turn / DEGREE).toFixed(0)} deg between scans` : "";
  }

  /** The velocity at its time, with the parts of its covariance and the budget's lag in it. */
  function carried({ theta, parts, delay }, by, lag) {
    const noise = sum(parts.noise, product(product(delay, by.covariance), transposed(delay))),
      moved = by.value.map((each) => lag * each);
    return {
      theta: minus(theta, apply(delay, by.value)),
      parts: { ...parts, noise: symmetric(noise), systematic: sum(parts.systematic, outer(moved, moved)) },
    };
  }

  const STEADY = { value: [0, 0, 0] }; // an acceleration

  /**
   * Estimates the velocity of one round after the other, and remembers the last accepted one.  Without a budget it accepts
   * any motion, and gives no covariances.
   */
  class Follower {
    constructor(model, budget, limits) {
      Object.assign(this, { model, budget, limits, velocity: null, last: null });
      this.acceleration = new AccelerationFilter();
    }

    /** The row of a track: {time, interval, theta, covariance, reason, targets, inliers, parts}. */
    follow(round) {
      const { pairs, time } = round;
      if (!pairs.length) return this.held(round, round.reason);
      const by = this.budget ? (this.acceleration.predict(time) ?? dopplerAcceleration(pairs, UNKNOWN)) : STEADY,
        near = this.velocity ?? [0, 0, 0],
        problem = problemOf(pairs, this.model, by.value, near),
        estimate = this.estimate(problem, pairs, by.value),
        seen = { targets: sizeOf(pairs), inliers: estimate.inliers };
      let reason = doubt(estimate, pairs);
      if (reason) return this.held(round, reason, seen);
      if (!this.budget) {
        this.velocity = estimate.theta;
        return { time, theta: estimate.theta, interval: round.interval, reason, ...seen };
      }
      const { parts: raw, delay, lead } = applyBudget(problem, estimate, pairs, this.budget, time, near),
        uncarried = { theta: minus(estimate.theta, apply(lead, by.value)), parts: raw, delay },
        { theta, parts } = carried(uncarried, by, this.budget.lag),
        state = { time, theta, covariance: sum(parts.noise, parts.dependence, parts.systematic) };
      reason = isFinite(state.covariance)
        ? exceeded(this.limits, state, this.last)
        : "a covariance that is not finite";
      if (reason) return this.held(round, reason, seen);
      this.last = state;
      this.velocity = estimate.theta;
      this.acceleration.update(time, uncarried.theta, delay, sum(raw.noise, raw.dependence), by);
      return { ...state, interval: round.interval, reason: "", ...seen, parts };
    }

    /** The row of a round that gives no estimate. */
    held({ time, interval }, reason, seen = { targets: 0, inliers: NaN }) {
      const unknown = filled(3, 3, NaN),
        parts = { noise: unknown, dependence: unknown, systematic: unknown };
      const theta = this.last?.theta ?? this.velocity ?? [0, 0, 0];
      return { time, interval, theta, covariance: unknown, reason, ...seen, parts };
    }

    /** The optimum near the last velocity; where it is doubtful, the better of two. */
    estimate(problem, pairs, acceleration) {
      const near = this.velocity && estimateVelocity(problem, [this.velocity]);
      if (near?.converged && near.inliers >= WELL_EXPLAINED) return near;
      const anew = estimateVelocity(problem, dopplerStarts(viewsOf(pairs, acceleration)));
      if (!near || isGood(near) !== isGood(anew)) return near && isGood(near) ? near : anew;
      return near.value <= anew.value ? near : anew;
    }
  }

  /** The later scans with the Doppler velocities that they would have at the time of `problemOf`. */
  function viewsOf(pairs, acceleration) {
    const time = middleOf(pairs);
    return pairs.map(({ current, mounting }) => {
      const gained = acceleration.map((each) => (current.time - time) * each);
      const targets = current.targets.map((target) => ({
        ...target,
        doppler: target.doppler - dot(d2d.dopplerGradients(target.azimuth, mounting).gain, gained),
      }));
      return { scan: { time: current.time, targets }, mounting };
    });
  }

  // ---- d2d/radar/tracks/tracker.py and the options of d2d/radar/cli.py -----------------------------------------------------

  const NO_SIDE_SLIP = 1e-3; // m/s

  // In the units of the command line, which they have as options of the same names.
  const DEFAULTS = {
    mountings: {}, // by the sensors' names, {x, y, yaw} in m, m, degrees
    degrees: false,
    sigmas: { range: null, azimuth: null, doppler: null }, // m, degrees, m/s; null: as in the columns
    baseline: 1,
    horizon: null, // s
    maxInterval: MAX_INTERVAL, // s
    sideSlip: null, // m/s; null: unknown
    maxAcceleration: LIMITS.acceleration, // m/s^2
    extent: 0, // m
    budget: { azimuth: 0, doppler: 0, scale: 0, lag: 0, neighbours: 0 }, // degrees, m/s, share, s, m
  };

  /** The same in m, rad and s, as the functions here take it. */
  function inRadians(given) {
    const { sigmas, budget, sideSlip } = given,
      slip = sideSlip === 0 ? NO_SIDE_SLIP : (sideSlip ?? Infinity);
    const known = Object.entries({ ...sigmas, azimuth: sigmas.azimuth === null ? null : sigmas.azimuth * DEGREE });
    return {
      ...given,
      mountings: Object.fromEntries(
        Object.entries(given.mountings).map(([name, { x, y, yaw }]) => [name, { x, y, yaw: yaw * DEGREE }]),
      ),
      sigmas: Object.fromEntries(
        known.filter(([, sigma]) => sigma !== null).map(([name, sigma]) => [`sigma_${name}`, sigma]),
      ),
      model: { prior: [0, 1 / slip ** 2, 0], extent: given.extent },
      limits: { ...LIMITS, acceleration: given.maxAcceleration },
      budget: { ...budget, azimuth: budget.azimuth * DEGREE },
    };
  }

  /**
   * The track of a log of `readRows` with all options of DEFAULTS: {rows, rounds, sensors, found, model, alone}.  If there are
   * several sensors, `alone` has {name, rows} of each by itself, unless it has too few scans.  A generator that yields the
   * share that is done, so that whoever runs it can show it, or stop.
   */
  function* track(log, given) {
    if (given.horizon !== null && given.baseline !== 1) {
      throw new Error("horizon and baseline must not both be given: leave the baseline at 1, or the horizon empty");
    }
    const options = inRadians(given),
      drives = loadCsv(log, options).map((sensor) => ({ ...sensor, mounting: options.mountings[sensor.name] })),
      several = drives.length > 1,
      joint = yield* shared(0, several ? 0.5 : 1, trackOf(drives, options)),
      alone = [];
    for (const [s, drive] of several ? drives.entries() : []) {
      const share = 0.5 / drives.length;
      try {
        const { rows } = yield* shared(0.5 + s * share, share, trackOf([drive], options));
        alone.push({ name: drive.name, rows });
      } catch {
        continue; // too few scans
      }
    }
    return { ...joint, alone };
  }

  /** What a generator returns, whose shares are a `part` of the whole, after `before`. */
  function* shared(before, part, steps) {
    for (;;) {
      const { done, value } = steps.next();
      if (done) return value;
      yield before + part * value;
    }
  }

  /** The track of sensors with their scans. */
  function* trackOf(drives, options) {
    for (const drive of drives) checkIntervals(drive, options.maxInterval);
    checkDistinct(drives);
    const intake = new Intake(
      drives.map(({ name }) => name),
      options.maxInterval,
    );
    const sensors = drives.map((drive, s) => ({ ...drive, scans: drive.scans.flatMap((scan) => intake.taken(s, scan)) })),
      timesOf = (some) => some.flatMap(({ scans }) => scans.map(({ time }) => time));
    sensors.forEach((own, s) => intake.lookForPause(s, timesOf([own]), timesOf(sensors.toSpliced(s, 1))));
    const found = [...intake.found, ...checkOverlap(sensors)];
    const rounds = roundsOf(sensors, options.baseline, options.horizon);
    if (!rounds.length) throw new Error("there must be at least two rounds of scans (of one sensor: two scans), but is one");
    const follower = new Follower(options.model, options.budget, options.limits),
      rows = [];
    for (const round of rounds) {
      rows.push(follower.follow(round));
      yield rows.length / rounds.length;
    }
    return { rows, rounds, sensors, found, model: options.model };
  }

  // ---- d2d/radar/tracks/track.py and files.py ------------------------------------------------------------------------------

  /** The path driven: poses [x, y, yaw], one more than rows. */
  function posesOf(rows) {
    const poses = [[0, 0, 0]];
    for (const { theta, interval } of rows) {
      const [x, y, yaw] = poses.at(-1),
        [dx, dy, turn] = d2d.exponential(...theta.map((each) => interval * each)).motion;
      const cosine = Math.cos(yaw),
        sine = Math.sin(yaw);
      poses.push([x + cosine * dx - sine * dy, y + sine * dx + cosine * dy, yaw + turn]);
    }
    return poses;
  }

  /** The path as a TUM trajectory file, one line "t x y z qx qy qz qw" per pose. */
  function tumOf(rows) {
    const times = [rows[0].time - rows[0].interval, ...rows.map((row) => row.time)];
    return posesOf(rows)
      .map(([x, y, yaw], i) => [times[i], x, y, 0, 0, 0, Math.sin(0.5 * yaw), Math.cos(0.5 * yaw)])
      .map((line) => `${line.map((each) => each.toFixed(9)).join(" ")}\n`)
      .join("");
  }

  const ENTRIES = {
    var_v_x: [0, 0, "m^2/s^2"],
    cov_v_x_v_y: [0, 1, "m^2/s^2"],
    cov_v_x_omega: [0, 2, "m*rad/s^2"],
    var_v_y: [1, 1, "m^2/s^2"],
    cov_v_y_omega: [1, 2, "m*rad/s^2"],
    var_omega: [2, 2, "rad^2/s^2"],
  };
  const TABLE_HEAD = [
    "# Velocities of a vehicle and their covariances, written by d2d, format 2",
    "# v_x forward and v_y left of the vehicle frame's origin, omega counter-clockwise. Where",
    "# converged is 0, the covariance is nan and the velocity is the last one that was accepted.",
    "# The covariance is the sum of three parts. To a filter, noise and dependence are white: new",
    "# in each estimate. The systematic part stays for 10 to 20 s on the road: it belongs in the",
    "# filter's state, as a random walk or a decaying error of that length.",
  ];

  /** A number with all its digits, as Python writes it. */
  function repr(value) {
    if (Number.isNaN(value)) return "nan";
    const [digits, exponent] = value.toExponential().split("e").map(String),
      power = Number(exponent);
    if (power < -4 || power >= 16) {
      return `${digits}e${power < 0 ? "-" : "+"}${String(Math.abs(power)).padStart(2, "0")}`;
    }
    return Number.isInteger(value) ? value.toFixed(1) : String(value);
  }

  /** The velocities with their covariances as a table of text. */
  function tableOf(rows) {
    const parts = ["noise", "dependence", "systematic"],
      own = "time[s] interval[s] v_x[m/s] v_y[m/s] omega[rad/s] converged[0/1]";
    const named = (prefix) => Object.entries(ENTRIES).map(([name, [, , unit]]) => `${prefix}${name}[${unit}]`),
      entries = (matrix) => Object.values(ENTRIES).map(([i, j]) => repr(matrix[i][j]));
    const columns = [own, ...named(""), ...parts.flatMap((part) => named(`${part}_`))];
    const lines = rows.map((row) =>
      [
        ...[row.time, row.interval, ...row.theta].map(repr),
        row.reason ? 0 : 1,
        ...entries(row.covariance),
        ...parts.flatMap((part) => entries(row.parts[part])),
      ].join(" "),
    );
    return [...TABLE_HEAD, `# ${columns.join(" ")}`, ...lines, `# end of ${rows.length} estimates`, ""].join("\n");
  }

  return {
    DEFAULTS,
    Follower,
    readRows,
    track,
    posesOf,
    tumOf,
    tableOf,
    finding,
    median,
    mean,
    problemOf,
    sensorFit,
    source: String(radarTracker), // as that of engine.js
  };
})();
