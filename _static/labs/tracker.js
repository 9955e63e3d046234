// The track of a standard log in the browser: the plain path of `python -m d2d.radar track`, with the same rounds, filter and
// budget.  Each section names the module of d2d that it mirrors; tests/book/test_tracker.py compares the results with d2d's.
//
// A classic script like engine.js, on which it builds; it defines one name, `tracker`.
//
// A target is {range, azimuth, doppler, sigmaRange, sigmaAzimuth, sigmaDoppler} in m, rad and m/s, a scan
// {time, targets}, a mounting {x, y, yaw} in m and rad, a sensor {name, scans, mounting}.  A velocity is
// [v_x, v_y, omega]; a matrix is an array of its rows.
globalThis.tracker = (function radarTracker() {
  "use strict";

  const { mean, median } = d2d,
    DEGREE = Math.PI / 180;

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

  const inverse = (a) => pseudoInverse(a, 0).inverse; // of a positive definite matrix
  const percent = (share) => `${(100 * share).toFixed(0)}%`;

  // ---- d2d/radar/readers/csv_log.py, for a log in the standard columns and units ---------------------------------------------

  const MEASURED = ["time", "range", "azimuth", "doppler"],
    SIGMAS = ["sigma_range", "sigma_azimuth", "sigma_doppler"],
    MAX_INTERVAL = 60; // s
  const BOUNDS = {
    range: { above: 0, most: 1e4, unit: "in m, ", hint: "; are these millimetres or centimetres?" },
    azimuth: { most: 2 * Math.PI * (1 + 1e-6), unit: "in radians (rad), ", hint: "; are these degrees? The command line takes --degrees" },
    sigma_range: { above: 0 },
    sigma_azimuth: { above: 0 },
    sigma_doppler: { above: 0 },
  };

  /** As Python's format {:g}. */
  const short = (value) => String(Number(value.toPrecision(6)));

  /** The number in a cell; an Error says what it must be. */
  function number(name, text) {
    const value = /^\s*$/.test(text) ? NaN : Number(text),
      { above = -Infinity, most = Infinity, unit = "", hint = "" } = BOUNDS[name] ?? {};
    if (Number.isNaN(value) && !/^\s*[+-]?nan\s*$/i.test(text)) {
      throw new Error(`${name} must be a number, with a decimal point, but is '${text}'`);
    }
    if (!Number.isFinite(value)) throw new Error(`${name} must be finite, but holds nan or inf`);
    if (value <= above) throw new Error(`${name} must be positive, but is ${short(value)}`);
    if (Math.abs(value) > most) throw new Error(`${name} must be ${unit}at most ${short(most)}, but is ${short(value)}${hint}`);
    return value;
  }

  /** The cells of a line; a name may stand in quotation marks. */
  const cellsOf = (line, separator) => line.split(separator).map((cell) => cell.trim().replace(/^"(.*)"$/, "$1"));

  /** The first line that is no comment, perhaps behind a #, names the columns: {names, separator, line}. */
  function readHeader(lines, source) {
    for (const [line, text] of lines.entries()) {
      const count = (mark) => text.split(mark).length,
        separator = [",", ";", "\t"].reduce((best, mark) => (count(mark) > count(best) ? mark : best)),
        names = cellsOf(text.replace(/^[# ]+/, ""), separator).map((name) => name.toLowerCase());
      if (MEASURED.every((name) => names.includes(name))) return { names, separator, line };
      if (text.trim() && !text.startsWith("#")) {
        throw new Error(
          `${source}, line ${line + 1}: the first line must name the columns ${MEASURED.join(", ")}, but names ` +
            `${names.map((name) => `'${name}'`).join(", ")}; the command line takes other names (--columns)`,
        );
      }
    }
    throw new Error(`${source} is empty: its first line must name the columns`);
  }

  /** A log {source, columns, targets, sensors}; each sensor {name, scans} in the order of the lines, which must be that of time. */
  function readLog(text, source) {
    const lines = text.split(/\r\n|\n|\r/),
      { names, separator, line: first } = readHeader(lines, source),
      columns = [...MEASURED, ...SIGMAS].filter((name) => names.includes(name)),
      sensors = new Map();
    let targets = 0;
    for (let i = first + 1; i < lines.length; i++) {
      if (!lines[i].trim() || lines[i].startsWith("#")) continue;
      try {
        addTarget(sensors, lines[i], { names, separator, columns });
      } catch (error) {
        throw new Error(`${source}, line ${i + 1}: ${error.message}`);
      }
      targets += 1;
    }
    if (!targets) throw new Error(`${source} has no line with a target`);
    for (const [name, scans] of sensors) checkIntervals(name, scans);
    return { source, columns, targets, sensors: [...sensors].map(([name, scans]) => ({ name, scans })) };
  }

  /** Add the target of a line to the latest scan of its sensor, or to a new one. */
  function addTarget(sensors, text, { names, separator, columns }) {
    const cells = cellsOf(text, separator);
    if (cells.length !== names.length) {
      throw new Error(`there must be ${names.length} values as in the first line, but are ${cells.length}`);
    }
    const sensor = names.includes("sensor") ? cells[names.indexOf("sensor")] : "radar";
    if (!sensor) throw new Error("sensor must be a name or a number, but is empty");
    const values = Object.fromEntries(columns.map((name) => [name, number(name, cells[names.indexOf(name)])])),
      { time, range, azimuth, doppler } = values,
      scans = sensors.get(sensor) ?? [],
      latest = scans.at(-1);
    sensors.set(sensor, scans);
    if (latest && time < latest.time) {
      throw new Error(
        `the time of ${sensor} steps back from ${latest.time} s to ${time} s; this page takes times as they come. ` +
          "Sort the lines, or use the command line, which begins a new segment there",
      );
    }
    if (time !== latest?.time) scans.push({ time, targets: [] });
    const [sigmaRange, sigmaAzimuth, sigmaDoppler] = SIGMAS.map((name) => values[name]);
    scans.at(-1).targets.push({ range, azimuth, doppler, sigmaRange, sigmaAzimuth, sigmaDoppler });
  }

  const intervalsOf = (scans) => scans.slice(1).map((scan, i) => scan.time - scans[i].time);

  /** Refuse times that are usually farther apart than a minute. */
  function checkIntervals(name, scans) {
    const intervals = intervalsOf(scans);
    if (intervals.length && median(intervals) > MAX_INTERVAL) {
      throw new Error(
        `${name} must have times in seconds (s), at most ${MAX_INTERVAL} apart, but ${scans[1].time} comes after ` +
          `${scans[0].time}; are these nano-, milli- or microseconds?`,
      );
    }
  }

  /** The sensors of a log with their mountings and, where the file has no column, the standard deviations of all targets. */
  function sensorsOf({ source, columns, sensors }, { mountings, sigmas }) {
    const missing = SIGMAS.filter((name) => !columns.includes(name) && !(sigmas[name] > 0));
    if (missing.length) throw new Error(`${source} has no column ${missing.join(", ")}: give it for all targets`);
    const given = {
      ...(!columns.includes("sigma_range") && { sigmaRange: sigmas.sigma_range }),
      ...(!columns.includes("sigma_azimuth") && { sigmaAzimuth: sigmas.sigma_azimuth * DEGREE }),
      ...(!columns.includes("sigma_doppler") && { sigmaDoppler: sigmas.sigma_doppler }),
    };
    return sensors.map(({ name, scans }) => {
      const { x, y, yaw } = mountings[name];
      return {
        name,
        mounting: { x, y, yaw: yaw * DEGREE },
        scans: scans.map(({ time, targets }) => ({ time, targets: targets.map((target) => ({ ...target, ...given })) })),
      };
    });
  }

  // ---- d2d/radar/scans/scan.py ---------------------------------------------------------------------------------------------

  /** The targets as Gaussians in the vehicle frame. */
  const placed = ({ targets }, mounting) =>
    targets.map(({ range, azimuth, sigmaRange, sigmaAzimuth }) => {
      const point = d2d.fromPolar(range, azimuth + mounting.yaw, sigmaRange, sigmaAzimuth);
      return { ...point, x: point.x + mounting.x, y: point.y + mounting.y };
    });

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
        gain = product(transposed(crossed), inverse(expected));
      const difference = minus(
        minus(second.velocity, first.velocity).map((each) => each / interval),
        apply(to, value),
      );
      if (d2d.nees(difference, expected) < CONTRADICTING ** 2) {
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
    const alone = () => views.flatMap(startsAlone);
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
  function pairProblem({ previous, current, mounting, interval }, [byMiddle, byScan]) {
    const [vx, vy, turn] = byMiddle.map((each) => interval * each),
      [cosine, sine] = [Math.cos(turn), Math.sin(turn)];
    const ahead = ({ x, y }) => ({
      x: cosine * x - sine * y + vx - 0.5 * turn * vy,
      y: sine * x + cosine * y + vy + 0.5 * turn * vx,
    });
    const moving = placed(current, mounting).map((point, k) => {
      const { doppler, azimuth, sigmaDoppler, sigmaAzimuth } = current.targets[k],
        measured = d2d.dopplerMeasurement(doppler, azimuth, sigmaDoppler, sigmaAzimuth, mounting);
      measured.value -= dot(measured.gain, byScan);
      return { ...point, ...ahead(point), doppler: measured };
    });
    return { fixed: placed(previous, mounting), moving, outlier: OUTLIER, interval, dopplerWidth: DOPPLER_WIDTH };
  }

  /** The cost of the velocity that pairs of scans share; with an acceleration, of that at the middle of the pairs. */
  function problemOf(pairs, acceleration, near) {
    const time = middleOf(pairs),
      gained = (passed) => acceleration.map((each) => passed * each);
    return {
      pairs: pairs.map((pair) => {
        const byMiddle = apply(following(near, pair.interval), gained(pair.middle - time));
        return pairProblem(pair, [byMiddle, gained(pair.current.time - time)]);
      }),
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
      cross = { moving: [], value: [], input: [] };
    for (const target of moving) {
      const p = d2d.move(target, [0, 0, phi]),
        factor = dopplerFactor(target.doppler, theta),
        slope = inMotion(factor.gradient);
      const inlying = Math.log1p(-OUTLIER.fraction) + factor.log,
        outlying = Math.log(OUTLIER.fraction / DOPPLER_WIDTH);
      const spread = ({ xx, xy, yy }, wide) => (wide ? OUTLIER : { xx: xx + p.xx, xy: xy + p.xy, yy: yy + p.yy });
      const all = [];
      for (let n = 0; n < 2 * fixed.length; n++) {
        const component = fixed[n >> 1],
          { xx, xy, yy } = spread(component, n & 1),
          determinant = xx * yy - xy * xy,
          bxx = yy / determinant,
          bxy = -xy / determinant,
          byy = xx / determinant,
          dx = p.x + tx - component.x,
          dy = p.y + ty - component.y,
          ux = bxx * dx + bxy * dy,
          uy = bxy * dx + byy * dy,
          log = (n & 1 ? outlying : inlying) - 0.5 * (dx * ux + dy * uy + Math.log(determinant));
        const own = n & 1 ? 0 : 1, // S turns with the target: C_phi = [[e, h], [h, -e]]
          e = own * -2 * p.xy,
          h = own * (p.xx - p.yy),
          bentX = e * ux + h * uy,
          bentY = h * ux - e * uy;
        const byAngle = ux * (0.5 * bentX + p.y) + uy * (0.5 * bentY - p.x) - 0.5 * (e * (bxx - byy) + 2 * h * bxy);
        const g0 = own * slope[0] - ux,
          g1 = own * slope[1] - uy,
          g2 = own * slope[2] + byAngle;
        all.push({ component: byFixed[n >> 1], log, own, ux, uy, bxx, bxy, byy, g0, g1, g2, vx: -p.y - bentX, vy: p.x - bentY });
      }
      const top = all.reduce((most, { log }) => Math.max(most, log), -Infinity),
        terms = all.filter(({ log }) => log >= top - 40), // others change nothing
        weights = terms.map(({ log }) => Math.exp(log - top)),
        total = weights.reduce((a, b) => a + b),
        [m0, m1, m2] = ["g0", "g1", "g2"].map((g) => weights.reduce((sum, weight, i) => sum + weight * terms[i][g], 0) / total);
      const moved = filled(3, 2),
        centred = [0, 0, 0];
      let share = 0;
      terms.forEach(({ component, own, ux, uy, bxx, bxy, byy, vx, vy, ...term }, i) => {
        const gamma = weights[i] / total,
          [g0, g1, g2] = [term.g0 - m0, term.g1 - m1, term.g2 - m2];
        const block = [
          gamma * (bxx + g0 * ux),
          gamma * (bxy + g0 * uy),
          gamma * (bxy + g1 * ux),
          gamma * (byy + g1 * uy),
          gamma * (bxx * vx + bxy * vy + g2 * ux),
          gamma * (bxy * vx + byy * vy + g2 * uy),
        ];
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
      });
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
  function addDependence(positions, points, length, noise) {
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
      addTo(noise, sum(both, transposed(both)));
    });
  }

  const propagated = (inverse, noise) => symmetric(product(product(inverse, noise), inverse));

  /** Derivative of a gradient in a small motion that follows the pair's own. */
  function ofDisplacement(positions, turned, mounting) {
    const total = sum(filled(3, 2), ...positions);
    return total.map(([x, y], i) => [x, y, turned[i] - mounting.y * x + mounting.x * y]);
  }

  const MARGINALISED = 0.2; // of the budget's standard deviations

  /** Take shared errors into the weights of a scan's Doppler velocities; what is lost of Hessian and gradient. */
  function marginaliseShared(cross, targets, theta, shares, budget) {
    const rows = targets.map(({ doppler: { value, variance, inputVariance, gain, slope } }, k) => {
      const turned = dot(slope, theta);
      return {
        ...{ gain, turned, residual: dot(gain, theta) - value },
        common: [MARGINALISED * budget.doppler, MARGINALISED * budget.azimuth * turned],
        weight: shares[k] / (variance + inputVariance * turned * turned),
      };
    });
    const ofRows = (left, right) => product(transposed(rows.map(left)), rows.map(right)),
      common = (row) => row.common,
      weighted = (row) => row.common.map((each) => row.weight * each);
    const gains = product(
      inverse(sum(identity(2), ofRows(common, weighted))),
      ofRows(weighted, (row) => row.gain),
    );
    const lost = product(rows.map(weighted), gains);
    cross.value = sum(cross.value, lost);
    cross.input = cross.input.map((row, k) => minus(row, lost[k].map((each) => rows[k].turned * each)));
    return {
      hessian: ofRows((row) => row.gain, (_, k) => lost[k]),
      gradient: apply(transposed(lost), rows.map((row) => row.residual)),
    };
  }

  /**
   * The estimate as input of the filter {step, white, delay, slow}, with the columns of the slow errors in the places of
   * their sensors, and its lead: see `apply_budget`, `FilterInput`.
   */
  function applyBudget(problem, { theta, hessian, shares }, pairs, { budget, sensors }, time, near) {
    const [noise, delayed, led] = Array.from({ length: 3 }, () => filled(3, 3)),
      slow = Array.from({ length: 2 * sensors + 1 }, () => [0, 0, 0]),
      common = middleOf(pairs);
    let [left, pulled, seen] = [hessian, [0, 0, 0], 0];
    pairs.forEach((pair, number) => {
      const { fixed, moving, interval } = problem.pairs[number],
        cross = crossDerivatives(problem.pairs[number], theta),
        lost = marginaliseShared(cross, moving, theta, shares.slice(seen, (seen += moving.length)), budget);
      left = sum(left, scaled(lost.hessian, -1));
      pulled = minus(pulled, lost.gradient);
      const turned = [
        [pair.previous, cross.fixed, fixed],
        [pair.current, cross.moving, moving],
      ].map(([scan, positions, points]) => {
        const slope = crossRange(scan, pair.mounting);
        addPositions(positions, points, noise);
        if (points === moving) addMeasurements(cross, scan, slope, noise);
        if (budget.neighbours) addDependence(positions, points, budget.neighbours, noise);
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
      const gradients = [
        [pair.sensor, budget.azimuth, totalOf([...cross.input, ...turned])],
        [sensors + pair.sensor, budget.doppler, totalOf(cross.value)],
        [2 * sensors, budget.scale, totalOf(cross.value.map((row, k) => row.map((each) => each * pair.current.targets[k].doppler)))],
      ];
      for (const [n, sigma, gradient] of gradients) slow[n] = slow[n].map((each, i) => each + sigma * gradient[i]);
    });
    const covariance = inverse(left),
      gain = scaled(covariance, -1);
    return {
      step: apply(gain, pulled),
      white: propagated(covariance, noise),
      slow: transposed(slow.map((column) => apply(gain, column))),
      delay: product(gain, delayed),
      lead: product(gain, led),
    };
  }

  // ---- d2d/radar/tracks/intake.py: each scan once, each target once ----------------------------------------------------------

  const STEP = 1, // s
    STEP_CYCLES = 5, // of a pause after which one scan alone may have a wrong stamp
    FEW = 6, // targets, of which some may be equal by chance where a radar rounds coarsely
    MOVING = 0.5; // m/s; at a standstill a coarse radar may measure the same twice

  const measured = ({ range, azimuth, doppler }) => `${range} ${azimuth} ${doppler}`;

  /** The scan with one of each two equal targets, if half of them are there twice. */
  function withoutTwins(scan) {
    const seen = new Set(),
      once = scan.targets.filter((target) => !seen.has(measured(target)) && seen.add(measured(target))),
      twins = scan.targets.length - once.length;
    return scan.targets.length < FEW || 2 * twins < scan.targets.length - 1 ? scan : { ...scan, targets: once };
  }

  /** Whether a scan has all targets of the one before while the sensor moves. */
  const repeats = (previous, { targets }) =>
    previous.targets.map(measured).join() === targets.map(measured).join() &&
    median(targets.map(({ doppler }) => Math.abs(doppler))) > MOVING;

  /** The longest time to the next scan that is in step. */
  const reachOf = (scans) => Math.max(STEP, STEP_CYCLES * median(intervalsOf(scans.slice(-REMEMBERED - 1))));

  /** A sensor with the scans that are used, and in `leftOut` what is not, in words. */
  function usable({ scans, ...sensor }) {
    const used = [],
      leftOut = new Set();
    let held = null; // a scan that comes so late that its stamp may be wrong
    for (const given of scans) {
      const scan = withoutTwins(given),
        before = held ?? used.at(-1);
      if (scan !== given) leftOut.add("it gives targets twice; one of each is left out.");
      if (before && repeats(before, scan)) leftOut.add("it repeats scans while it moves; they are left out.");
      else if (!held && used.length > 1 && scan.time > before.time + reachOf(used)) held = scan;
      else {
        used.push(...(held ? [held] : []), scan);
        held = null;
      }
    }
    if (held) leftOut.add(`its last scan, at ${held.time} s, comes alone after a gap and is left out: is its time stamp wrong?`);
    return { ...sensor, scans: used, leftOut: [...leftOut] };
  }

  // ---- d2d/radar/tracks/rounds.py ------------------------------------------------------------------------------------------

  const AFTER_GAP = "the first scan after a gap",
    HORIZON = 0.3, // s
    REMEMBERED = 9, // intervals
    ROUND = 1.5, // cycles
    PAIR_GAP = 2.5, // cycles
    LONGER = 1.5; // horizons

  /** The latest scans of one sensor, and the time that it usually takes from one to the next. */
  class History {
    constructor(mounting) {
      Object.assign(this, { mounting, scans: [], intervals: [] });
    }

    /** The usual time from one scan to the next; infinite while there is only one. */
    get cycle() {
      return this.intervals.length ? median(this.intervals) : Infinity;
    }

    /** The next scan, paired with that nearest to the horizon before, or the first; null if none is near enough. */
    paired(scan) {
      const { scans, intervals } = this,
        passed = ({ time }) => scan.time - time,
        wanted = scan.time - HORIZON,
        off = ({ time }) => Math.round(1e6 * Math.abs(time - wanted)); // rounding must not decide
      if (scans.length) {
        intervals.push(passed(scans.at(-1)));
        if (intervals.length > REMEMBERED) intervals.shift();
        const longest = Math.max(LONGER * HORIZON, PAIR_GAP * this.cycle);
        while (scans.length && passed(scans[0]) > longest) scans.shift();
      }
      const previous = scans.length && scans.reduceRight((best, each) => (off(each) < off(best) ? each : best));
      scans.push(scan);
      while (scans.length > 1 && scans[1].time <= wanted) scans.shift();
      return previous ? pairOf(previous, scan, this.mounting) : null;
    }
  }

  /** All rounds but the first: {time, interval, pairs, reason}, see `Rounds`. */
  function roundsOf(sensors) {
    const histories = sensors.map(({ mounting }) => new History(mounting)),
      rounds = [];
    let open = new Map(),
      start = NaN,
      last = NaN;
    const finish = () => {
      const scans = open;
      open = new Map();
      if (!scans.size) return;
      const key = (s) => [scans.get(s).time, histories[s].mounting.x, histories[s].mounting.y, histories[s].mounting.yaw];
      const order = [...scans.keys()].sort((a, b) => key(a).reduce((by, each, i) => by || each - key(b)[i], 0)),
        pairs = order.map((s) => ({ ...histories[s].paired(scans.get(s)), sensor: s })).filter((pair) => pair.previous),
        time = mean(order.map((s) => scans.get(s).time)),
        interval = time - last;
      last = time;
      if (!Number.isNaN(interval)) rounds.push({ time, interval, pairs, reason: AFTER_GAP });
    };
    const isOver = (time) =>
      Math.abs(time - start) > ROUND * Math.min(...[...open.keys()].map((sensor) => histories[sensor].cycle));
    const waiting = sensors
      .flatMap(({ scans }, s) => scans.map((scan) => ({ s, scan })))
      .sort((a, b) => a.scan.time - b.scan.time || a.s - b.s);
    for (let i = 0; i < waiting.length; ) {
      let end = i + 1;
      while (end < waiting.length && waiting[end].scan.time === waiting[i].scan.time) end += 1;
      // of equal times, sensors that the open round already holds come first: they end it
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
    return rounds;
  }

  // ---- d2d/radar/tracks/limits.py ------------------------------------------------------------------------------------------

  const HARD = 0.5, // s
    BEYOND = 3; // standard deviations
  const LIMITS = {
    speed: 100, // m/s
    yawRate: 3, // rad/s
    acceleration: 12, // m/s^2
    yawAcceleration: 1.5, // rad/s^2
    uncertainty: 0.12, // rad/s
    speedUncertainty: 0.4, // m/s
    yawRateOfSlip: 0.15, // rad/s
  };

  const sigmasOf = (covariance) => covariance.map((row, i) => Math.sqrt(row[i]));

  /** What a state {time, theta, covariance} exceeds, in words; empty if it is plausible after the last one. */
  function exceeded({ time, theta, covariance }, last) {
    const sigmas = sigmasOf(covariance),
      speed = Math.hypot(theta[0], theta[1]),
      turn = Math.abs(theta[2]),
      widest = Math.max(sigmas[0], sigmas[1]);
    if (speed > LIMITS.speed + BEYOND * Math.hypot(sigmas[0], sigmas[1])) return `a speed of ${speed.toFixed(1)} m/s`;
    if (turn > LIMITS.yawRate + BEYOND * sigmas[2]) return `a yaw rate of ${(turn / DEGREE).toFixed(1)} deg/s`;
    if (sigmas[2] > LIMITS.uncertainty) return `a yaw rate with a sigma of ${(sigmas[2] / DEGREE).toFixed(1)} deg/s`;
    if (widest > LIMITS.speedUncertainty) return `a velocity with a sigma of ${widest.toFixed(1)} m/s`;
    if (Math.abs((theta[1] * covariance[1][2]) / covariance[1][1]) > LIMITS.yawRateOfSlip) {
      return `a side slip of ${theta[1].toFixed(2)} m/s`;
    }
    if (!last) return "";
    const interval = time - last.time,
      enough = Math.min(interval, Math.sqrt(interval * HARD)),
      before = sigmasOf(last.covariance);
    const axes = [
      [LIMITS.acceleration, "an acceleration", "m/s^2 along x"],
      [LIMITS.acceleration, "an acceleration", "m/s^2 along y"],
      [LIMITS.yawAcceleration, "a yaw acceleration", "rad/s^2"],
    ];
    for (const [axis, [limit, kind, unit]] of axes.entries()) {
      const change = Math.abs(theta[axis] - last.theta[axis]),
        spread = BEYOND * Math.hypot(sigmas[axis], before[axis]);
      if (change > limit * enough + spread) return `${kind} of ${(change / interval).toFixed(1)} ${unit}`;
    }
    return "";
  }

  // ---- d2d/radar/tracks/filter.py ------------------------------------------------------------------------------------------

  const UNKNOWN = diagonal([1.3 ** 2, 0.09 ** 2, 0.12 ** 2]), // variances of the acceleration
    JERK = [1.5 ** 2, 0.0225 ** 2, 0.0375 ** 2], // variances per s
    JERK_SCALES = [1, 10, 100], // of the modes of driving
    MODE_DURATION = 5, // s on average
    PERSISTENCE = 15, // s, of the slow errors
    MEMORY = 2, // s
    GUESSED = 2, // s, for which acceleration, side slip and yaw rate last
    IMPLAUSIBLE = 12; // standard deviations

  // A belief is {mean, covariance, cross}: of [v, a], and its covariance with the slow errors, which are considered and not
  // learnt (Schmidt 1966); a mixture {time, shares, modes} has a belief of each mode.

  /** The moments of a mixture of beliefs. */
  function combined(shares, beliefs) {
    const mean = beliefs[0].mean.map((_, i) => dot(shares, beliefs.map((belief) => belief.mean[i]))),
      spread = ({ mean: own, covariance }) => sum(covariance, outer(minus(own, mean), minus(own, mean))),
      weighted = (matrixOf) => sum(...beliefs.map((belief, k) => scaled(matrixOf(belief), shares[k])));
    return { mean, covariance: weighted(spread), cross: weighted(({ cross }) => cross) };
  }

  /** The belief after a first estimate, for an acceleration {value, covariance} that nothing but the radar tells. */
  function begin(time, { velocity, white, delay, slow: columns, lag }, by = { value: [0, 0, 0], covariance: UNKNOWN }) {
    const late = product(delay, by.covariance),
      slow = columns.map((row, i) => [...row, -lag * by.value[i]]),
      own = sum(white, product(slow, transposed(slow)), product(late, transposed(delay)));
    const belief = {
      mean: [...minus(velocity, apply(delay, by.value)), ...by.value],
      covariance: [
        ...own.map((row, i) => [...row, ...late[i].map((each) => -each)]),
        ...transposed(late).map((row, i) => [...row.map((each) => -each), ...by.covariance[i]]),
      ],
      cross: [...scaled(slow, -1), ...filled(3, slow[0].length)],
    };
    return { time, shares: JERK_SCALES.map(() => 1 / JERK_SCALES.length), modes: JERK_SCALES.map(() => belief) };
  }

  /** The mixture at a later time; null if what was learnt is forgotten by then. */
  function predict({ time: before, shares: own, modes }, time) {
    const passed = time - before;
    if (passed > MEMORY) return null;
    const lasts = Math.exp(-passed / MODE_DURATION),
      changes = (1 - lasts) / own.length,
      shares = own.map((share) => lasts * share + changes),
      mixed = shares.map((share, i) => combined(own.map((from, k) => (from * (changes + (i === k ? lasts : 0))) / share), modes));
    return { time, passed, shares, modes: mixed.map((belief, i) => moved(belief, passed, JERK_SCALES[i])) };
  }

  /** A belief after a time, in which the acceleration walks and the slow errors change. */
  function moved({ mean, covariance, cross }, passed, scale) {
    const transition = identity(6);
    for (let i = 0; i < 3; i++) transition[i][i + 3] = passed;
    const after = product(product(transition, covariance), transposed(transition));
    JERK.map((usual) => scale * usual).forEach((jerk, i) => {
      after[i + 3][i + 3] += passed * jerk;
      after[i][i + 3] += (passed ** 2 / 2) * jerk;
      after[i + 3][i] += (passed ** 2 / 2) * jerk;
      after[i][i] += (passed ** 3 / 3) * jerk;
    });
    const kept = Math.exp(-passed / PERSISTENCE);
    return { mean: apply(transition, mean), covariance: after, cross: scaled(product(transition, cross), kept) };
  }

  /** The mixture after an estimate at its time; where no mode explains the estimate, it begins anew. */
  function update({ time, passed, shares, modes }, given) {
    const { delay, white } = given,
      interval = 2 * Math.abs(delay[2][2]),
      added = Math.max(interval / 5, interval ** 2 / (9 * passed)),
      uneven = product(product(delay, diagonal(JERK)), scaled(transposed(delay), added)),
      found = modes.map((belief, i) => updated(belief, { ...given, white: sum(white, scaled(uneven, JERK_SCALES[i])) }));
    if (Math.min(...found.map(({ squares }) => squares)) > IMPLAUSIBLE ** 2) return begin(time, given);
    const most = Math.max(...found.map(({ evidence }) => evidence)),
      weights = found.map(({ evidence }, i) => shares[i] * Math.exp(evidence - most)),
      total = weights.reduce((all, each) => all + each, 0);
    return { time, shares: weights.map((weight) => weight / total), modes: found.map(({ belief }) => belief) };
  }

  /** A belief after an estimate, and the log density that it gave it. */
  function updated({ mean, covariance, cross }, { velocity, white, delay, slow: columns, lag }) {
    const to = identity(3).map((row, i) => [...row, ...delay[i]]),
      slow = columns.map((row, i) => [...row, -lag * mean[i + 3]]),
      withState = sum(product(to, covariance), product(slow, transposed(cross))),
      withSlow = sum(product(to, cross), slow),
      spread = symmetric(sum(product(withState, transposed(to)), product(withSlow, transposed(slow)), white)),
      gain = product(transposed(withState), inverse(spread)),
      innovation = minus(velocity, apply(to, mean)),
      squares = d2d.nees(innovation, spread);
    return {
      belief: {
        mean: mean.map((each, i) => each + dot(gain[i], innovation)),
        covariance: symmetric(sum(covariance, scaled(product(gain, withState), -1))),
        cross: sum(cross, scaled(product(gain, withSlow), -1)),
      },
      squares,
      evidence: -0.5 * (squares + eigen(spread).values.reduce((total, each) => total + Math.log(each), 0)),
    };
  }

  /** The mean {time, mean} at a later time at which nothing was estimated: what turns and speeds up decays. */
  function guess({ time: before, mean }, time) {
    const kept = Math.exp((before - time) / GUESSED),
      velocity = [0, 1, 2].map((i) => (i ? kept : 1) * mean[i] + GUESSED * (1 - kept) * mean[i + 3]);
    return { time, mean: velocity[0] * mean[0] > 0 ? [...velocity, ...mean.slice(3).map((each) => kept * each)] : mean.map(() => 0) };
  }

  // ---- d2d/radar/tracks/estimator.py ---------------------------------------------------------------------------------------

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

  const whole = ({ shares, modes }) => combined(shares, modes);

  /** Estimates the velocity of one round after the other, and remembers the last accepted one. */
  class Estimator {
    constructor(budget, sensors) {
      Object.assign(this, { budget, sensors, velocity: null, last: null, belief: null, guessed: null });
    }

    /** The row of a track: {time, interval, theta, covariance, reason, targets, inliers}. */
    step(round) {
      const { pairs, time } = round;
      if (!pairs.length) return this.rejected(round, round.reason);
      const predicted = this.belief && predict(this.belief, time),
        first = predicted ? null : dopplerAcceleration(pairs, UNKNOWN),
        acceleration = predicted ? whole(predicted).mean.slice(3) : first.value,
        near = this.velocity ?? [0, 0, 0],
        problem = problemOf(pairs, acceleration, near),
        estimate = this.estimate(problem, pairs, acceleration),
        seen = { targets: sizeOf(pairs), inliers: estimate.inliers };
      let reason = doubt(estimate, pairs);
      if (reason) return this.rejected(round, reason, seen);
      const { step, lead, ...input } = applyBudget(problem, estimate, pairs, this, time, near),
        moved = minus(apply(lead, acceleration), step),
        given = { ...input, velocity: minus(estimate.theta, moved), lag: this.budget.lag },
        theta = minus(given.velocity, apply(given.delay, acceleration)),
        state = { time, theta, covariance: sum(given.white, product(given.slow, transposed(given.slow))) };
      reason = isFinite(state.covariance) ? exceeded(state, this.last) : "a covariance that is not finite";
      if (reason) return this.rejected(round, reason, seen);
      this.last = state;
      this.velocity = estimate.theta;
      this.belief = predicted ? update(predicted, given) : begin(time, given, first);
      const { mean, covariance } = whole(this.belief);
      this.guessed = { time, mean };
      const reported = { theta: mean.slice(0, 3), covariance: covariance.slice(0, 3).map((row) => row.slice(0, 3)) };
      return { time, interval: round.interval, ...reported, reason: "", ...seen };
    }

    /** The row of a round that gives no estimate. */
    rejected({ time, interval }, reason, seen = { targets: 0, inliers: NaN }) {
      this.guessed &&= guess(this.guessed, time);
      const theta = this.guessed?.mean.slice(0, 3) ?? [0, 0, 0];
      return { time, interval, theta, covariance: filled(3, 3, NaN), reason, ...seen };
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

  // ---- What the text of a log shows; all else is d2d.radar.diagnose's ------------------------------------------------------

  const FAR = 500, // m
    PRECISE = 0.03, // deg
    COARSE = 10, // deg
    SEEN = 5, // targets of a scan, and scans
    FAST = 3, // m/s
    ASKEW = 20, // deg
    BACKWARDS = 150; // deg

  /** Sentences on what is probably wrong with a sensor: units, stamps, and signs that its Doppler velocities contradict. */
  function doubtsOf({ scans, mounting, leftOut }) {
    const targets = scans.flatMap((scan) => scan.targets),
      distance = median(targets.map(({ range }) => range)),
      sigma = median(targets.map(({ sigmaAzimuth }) => sigmaAzimuth)) / DEGREE,
      single = mean(scans.map((scan) => (scan.targets.length <= 1 ? 1 : 0))),
      doubts = [...leftOut];
    if (distance > FAR) doubts.push(`half of its targets are beyond ${distance.toFixed(0)} m: are the ranges in centimetres?`);
    if (sigma < PRECISE) doubts.push(`its azimuths have a standard deviation of ${short(sigma)}°: is it in radians?`);
    if (sigma > COARSE) doubts.push(`its azimuths have a standard deviation of ${sigma.toFixed(0)}°: is it in degrees?`);
    if (single > 0.9) doubts.push("its scans have one target: all targets of a scan need the same time.");
    const headings = scans
      .filter((scan) => scan.targets.length >= SEEN)
      .map((scan) => sensorFit(scan, mounting).velocity)
      .filter((velocity) => Math.hypot(...velocity) > FAST)
      .map(([x, y]) => [x / Math.hypot(x, y), y / Math.hypot(x, y)]);
    if (headings.length < SEEN) return doubts;
    const [ahead, left] = [0, 1].map((axis) => median(headings.map((unit) => unit[axis]))),
      heading = Math.atan2(left, ahead) / DEGREE;
    if (Math.abs(heading) > BACKWARDS) {
      doubts.push("its Doppler velocities show a drive backwards: is their sign positive for targets that move away?");
    } else if (Math.abs(heading) > ASKEW) {
      doubts.push(
        `its Doppler velocities show a drive at ${heading.toFixed(0)}° from straight ahead: is its yaw right, and do its ` +
          "azimuths count counter-clockwise?",
      );
    }
    return doubts;
  }

  // ---- d2d/radar/tracks/tracker.py -----------------------------------------------------------------------------------------

  // In the units of the command line, which has them as options of the same names.
  const DEFAULTS = {
    mountings: {}, // by the sensors' names, {x, y, yaw} in m, m, degrees
    sigmas: {}, // of all targets, by the names of columns that the file lacks, in m, degrees, m/s
    budget: { azimuth: 0, doppler: 0, scale: 0, lag: 0, neighbours: 0 }, // degrees, m/s, share, s, m
  };

  /**
   * The track of a log of `readLog` with the settings of DEFAULTS: {rows, doubts}, a row {time, interval, theta, covariance,
   * reason, targets, inliers} for each round.  A generator that yields the share that is done, so that whoever runs it can
   * show it, or stop.
   */
  function* track(log, settings) {
    const sensors = sensorsOf(log, settings).map(usable),
      rounds = roundsOf(sensors),
      estimator = new Estimator({ ...settings.budget, azimuth: settings.budget.azimuth * DEGREE }, sensors.length),
      rows = [];
    if (!rounds.length) throw new Error("there must be at least two rounds of scans (of one sensor: two scans), but is one");
    for (const round of rounds) {
      rows.push(estimator.step(round));
      yield rows.length / rounds.length;
    }
    const doubts = sensors.flatMap((sensor) => doubtsOf(sensor).map((doubt) => `${sensor.name}: ${doubt}`));
    return { rows, doubts };
  }

  // ---- d2d/radar/tracks/path.py and output.py ------------------------------------------------------------------------------

  /** Velocities that make the path: the accepted ones, guesses where there was none for long, and one at the beginning. */
  function knotsOf(rows) {
    const accepted = rows.filter(({ reason }) => !reason),
      began = rows[0].time - rows[0].interval;
    if (!accepted.length) return [{ time: began, theta: rows[0].theta }];
    const isLost = ({ time }) => {
      const before = accepted.findLast((each) => each.time < time),
        after = accepted.find((each) => each.time >= time) ?? rows.at(-1);
      return before && after.time - before.time > MEMORY;
    };
    const known = rows.filter((row) => !row.reason || isLost(row)),
      [first] = known,
      time = Math.max(began, first.time - MEMORY),
      reach = first.time - time,
      later = known.find((each) => each.time >= first.time + reach) ?? known.at(-1),
      ratio = later === first ? 0 : reach / (later.time - first.time);
    return [{ time, theta: first.theta.map((each, i) => each - ratio * (later.theta[i] - each)) }, ...known];
  }

  /** The path driven: poses [x, y, yaw], one more than rows, by velocities that are linear between the accepted ones. */
  function posesOf(rows) {
    const knots = knotsOf(rows),
      poses = [[0, 0, 0]];
    let next = 1;
    const at = (time) => {
      while (next < knots.length - 1 && knots[next].time < time) next += 1;
      const [before, after] = [knots[next - 1], knots[next] ?? knots[0]],
        share = Math.min(Math.max((time - before.time) / (after.time - before.time || 1), 0), 1);
      return before.theta.map((each, i) => each + share * (after.theta[i] - each));
    };
    let velocity = at(rows[0].time - rows[0].interval);
    for (const { time, interval } of rows) {
      const before = velocity;
      velocity = at(time);
      // two terms of the Magnus expansion
      const turned = apply(bracket(before), velocity),
        twist = turned.map((each, i) => (interval / 2) * (before[i] + velocity[i]) + (interval ** 2 / 12) * each),
        [dx, dy, turn] = d2d.exponential(...twist).motion,
        pose = poses.at(-1),
        { x, y } = d2d.move({ x: dx, y: dy }, pose);
      poses.push([x, y, pose[2] + turn]);
    }
    return poses;
  }

  // ---- d2d/radar/tracks/support.py -----------------------------------------------------------------------------------------

  const IN_A_ROW = 3, // estimates
    BRIDGED = 1, // s
    BRIDGED_CYCLES = 2.5;

  /** The share of the time with estimates that were accepted in a row, short stretches without bridged. */
  function supportOf(rows) {
    const first = rows[0].time - rows[0].interval,
      last = rows.at(-1).time,
      times = [first, ...rows.map(({ time }) => time)],
      longest = Math.max(BRIDGED, BRIDGED_CYCLES * median(rows.map((_, i) => times[i + 1] - times[i]))),
      length = Math.min(IN_A_ROW, rows.length),
      begins = rows.map((_, i) => i + length <= rows.length && rows.slice(i, i + length).every(({ reason }) => !reason)),
      supports = (i) => begins.slice(Math.max(0, i - length + 1), i + 1).some(Boolean),
      known = [first, ...rows.filter((_, i) => supports(i)).map(({ time }) => time), last],
      stretches = known.slice(1).map((time, i) => time - known[i]);
    return 1 - stretches.reduce((missing, each) => missing + (each > longest ? each : 0), 0) / (last - first);
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
    var_v_x: [0, 0],
    cov_v_x_v_y: [0, 1],
    cov_v_x_omega: [0, 2],
    var_v_y: [1, 1],
    cov_v_y_omega: [1, 2],
    var_omega: [2, 2],
  };

  /** The velocities with their covariances as CSV, in the columns of `Track.write_velocities`, without what is a guess. */
  function csvOf(rows) {
    const head = ["time", "interval", "v_x", "v_y", "omega", "converged", ...Object.keys(ENTRIES)].join(),
      entries = (matrix) => Object.values(ENTRIES).map(([i, j]) => matrix[i][j]);
    const lines = rows.map((row) =>
      [row.time, row.interval, ...row.theta, row.reason ? "False" : "True", ...entries(row.covariance)]
        .map((value) => (Number.isNaN(value) ? "nan" : value))
        .join(),
    );
    return [head, ...lines, ""].join("\n");
  }

  return {
    DEFAULTS,
    readLog,
    track,
    posesOf,
    supportOf,
    tumOf,
    csvOf,
    source: String(radarTracker), // as engine.js's
  };
})();
