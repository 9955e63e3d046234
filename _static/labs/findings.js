// What a log and its track say about mistakes that were made with them, as `d2d.radar.diagnose` and the warnings of `track`;
// tests/book/test_tracker.py compares both.  Builds on engine.js and tracker.js; it defines one name, `findings`.
globalThis.findings = (function radarFindings() {
  "use strict";

  const { finding, mean, median, problemOf, sensorFit } = tracker;
  const DEGREE = Math.PI / 180,
    FEW = 5; // accepted estimates, or intervals
  const dot = (a, b) => a.reduce((sum, each, i) => sum + each * b[i], 0);
  const percent = (share) => `${(100 * share).toFixed(0)}%`;
  const signed = (value, decimals) => `${value < 0 ? "" : "+"}${value.toFixed(decimals)}`;
  const wrapped = (angle) => Math.atan2(Math.sin(angle), Math.cos(angle));
  const greatest = (values) => values.reduce((a, b) => Math.max(a, b), 0);
  const accepted = ({ rows, rounds }) => rows.map((row, i) => ({ row, pairs: rounds[i].pairs })).filter(({ row }) => !row.reason);
  const evenly = (members) => {
    const step = Math.max(1, Math.floor(members.length / 200));
    return members.filter((_, i) => i % step === 0);
  };

  // ---- d2d/radar/tracks/lateness.py ----------------------------------------------------------------------------------------

  const WITHIN = [3, 0.5], // m/s
    APART = 1e-3, // least squared sine between directions
    ROUNDS = 50,
    LATE = 0.07, // s
    SURE = 5, // standard deviations
    USELESS = 0.2, // s
    BEHIND = 0.5, // s
    ROUNDING = 1e-9, // relative
    ALIKE = 5; // estimates

  /** How much larger v_x is by a scan's static targets, by least squares of both components; nan if it shows none. */
  function excessOf(scan, mounting, theta) {
    const targets = scan.targets.map(({ azimuth, doppler }) => {
      const { gain } = d2d.dopplerGradients(azimuth, mounting);
      return { gain, rest: doppler - dot(gain, theta) };
    });
    let found = [0, 0];
    for (const within of WITHIN) {
      const before = found,
        near = targets.filter(({ gain, rest }) => Math.abs(rest - gain[0] * before[0] - gain[1] * before[1]) < within),
        total = (of) => near.reduce((sum, each) => sum + of(each), 0);
      if (near.length < SEEN) return NaN;
      const [xx, xy, yy] = [[0, 0], [0, 1], [1, 1]].map(([i, j]) => total(({ gain }) => gain[i] * gain[j])),
        [x, y] = [0, 1].map((i) => total(({ gain, rest }) => gain[i] * rest)),
        determinant = xx * yy - xy * xy;
      if (determinant < APART * xx * yy) return NaN;
      found = [(yy * x - xy * y) / determinant, (xx * y - xy * x) / determinant];
    }
    return found[0];
  }

  /** Sums of products without what the first columns explain of the others. */
  function withoutFirst(sums, count) {
    let left = sums;
    for (let k = 0; k < count; k++) {
      const before = left,
        own = before[k];
      if (own[k] <= ROUNDING * sums[k][k]) continue;
      left = before.map((row) => row.map((each, j) => each - (row[k] * own[j]) / own[k]));
    }
    return left;
  }

  /** Whether the Doppler velocities of a sensor are those of another time than its stamps say. */
  function ofLateness({ sensors, ...track }) {
    const place = ({ x, y, yaw }) => [x, y, yaw].join(),
      names = new Map(sensors.map(({ name, mounting }) => [place(mounting), name])),
      sums = new Map([...names.keys()].map((at) => [at, Array.from({ length: 5 }, () => [0, 0, 0, 0, 0])])),
      driven = [];
    const worst = () => {
      let found = { name: "", lag: 0 };
      for (const [at, own] of sums) {
        const [[n]] = own,
          left = withoutFirst(own, 3),
          spread = left[3][3];
        if (n < ROUNDS || spread <= ROUNDING * own[3][3]) continue;
        const slope = left[3][4] / spread,
          rest = Math.max(left[4][4] - slope ** 2 * spread, 0) / n,
          isSure = Math.abs(slope) > Math.max(LATE, SURE * Math.sqrt((ALIKE * rest) / spread));
        if (isSure && Math.abs(slope) > Math.abs(found.lag)) found = { name: names.get(at), lag: -slope };
      }
      const { name, lag } = found;
      if (!name) return [];
      const told = `${Math.abs(lag).toFixed(2)} s ${lag > 0 ? "late" : "early"}`;
      return [finding("the clock of a sensor is off", name, lag, "s", Math.abs(lag) > USELESS, told)];
    };
    let count = 0;
    for (const { row, pairs } of accepted(track)) {
      const { time, theta } = row;
      driven.push({ time, theta });
      while (driven.length > 2 && time - driven[1].time >= BEHIND) driven.shift();
      const [before] = driven;
      if (pairs.length < 2 || before.time === time) continue;
      const acceleration = theta.map((each, i) => (each - before.theta[i]) / (time - before.time)),
        found = new Map();
      for (const { current, mounting } of pairs) {
        const own = theta.map((each, i) => each + (current.time - time) * acceleration[i]),
          excess = excessOf(current, mounting, own);
        if (Number.isFinite(excess)) found.set(place(mounting), excess);
      }
      for (const [at, excess] of found) {
        const others = [...found].filter(([other]) => other !== at).map(([, value]) => value);
        if (!others.length) continue;
        const row = [1, theta[0], theta[2], acceleration[0], excess - median(others)];
        sums.set(
          at,
          sums.get(at).map((own, i) => own.map((each, j) => each + row[i] * row[j])),
        );
      }
      count += 1;
      const told = count % (2 * ROUNDS) ? [] : worst();
      if (told.length) return told;
    }
    return worst();
  }

  // ---- d2d/radar/tracks/contradiction.py -----------------------------------------------------------------------------------

  const SAMPLE = 20, // intervals
    TELLING = 3, // nats
    SLOW = 2, // m/s
    MARGIN = 0.5, // m/s
    ACCELERATING = 5; // m/s^2
  const BEYOND_REST = 1.15,
    AT_OPPOSITE = 0.5,
    AT_SLOWER = 0.15,
    AT_FEET = 0.3; // fractions of the speed
  const OPPOSITE = [-1, -1, 1],
    SLOWER = [1 / 3.6, 1 / 3.6, 1],
    FASTER = [3.6, 3.6, 1],
    MUCH_FASTER = [10, 10, 10],
    FEET = [1 / 0.3048, 1 / 0.3048, 1];
  const SYMPTOMS = {
    "the opposite velocity": "the path runs backwards",
    "a 3.6 times slower one": "Doppler velocities in km/h",
    "a faster one": "the vehicle hardly moves",
    "a 3.3 times faster one": "ranges in feet",
  };

  /**
   * The positions alone.  Their outlier component keeps the factor of its Doppler density, as in d2d: this fraction gives the
   * same cost but for a constant.
   */
  function withoutDoppler(problem) {
    const pairs = problem.pairs.map(({ moving, outlier, dopplerWidth, ...pair }) => {
      const weight = outlier.fraction / dopplerWidth;
      return {
        ...pair,
        moving: moving.map(({ doppler, ...position }) => position),
        outlier: { ...outlier, fraction: weight / (1 - outlier.fraction + weight) },
      };
    });
    return { ...problem, pairs };
  }

  /** What the positions fit better than a velocity, {kind, heading}; nothing if they do not. */
  function contradictionOf(problem, theta) {
    const alone = withoutDoppler(problem),
      speed = Math.hypot(theta[0], theta[1]),
      multiple = (factors) => theta.map((each, i) => each * factors[i]),
      valueAt = (velocity) => d2d.evaluate(alone, velocity).value;
    const tried = [OPPOSITE, SLOWER, FASTER, MUCH_FASTER, FEET].map(multiple).map((at) => ({ at, value: valueAt(at) })),
      start = tried.reduce((best, each) => (each.value < best.value ? each : best)).at;
    let other = d2d.minimise(alone, start);
    if (speed < SLOW) {
      const searched = d2d.register(alone, [0, 0, 0], d2d.ANNEALED);
      if (searched.value < other.value) other = searched;
    }
    if (!(other.converged && valueAt(theta) - other.value > TELLING)) return [];
    // positions fit the mean velocity, from which one at the later scan differs by an acceleration
    const gained = 0.5 * ACCELERATING * greatest(problem.pairs.map(({ interval }) => interval)),
      middle = d2d.register(alone, theta, d2d.ANNEALED),
      alike = Math.hypot(middle.theta[0] - theta[0], middle.theta[1] - theta[1]) < gained;
    if (middle.converged && alike && middle.value - other.value <= TELLING) return [];
    const away = (factors) => Math.hypot(...[0, 1].map((i) => other.theta[i] - factors[i] * theta[i])),
      length = Math.max(Math.hypot(other.theta[0], other.theta[1]), 1e-9),
      found = (kind) => [{ kind, heading: [other.theta[0] / length, other.theta[1] / length] }];
    if (speed > SLOW && away(FEET) < AT_FEET * FEET[0] * speed) return found("a 3.3 times faster one");
    if (away([1, 1, 1]) > BEYOND_REST * speed + MARGIN) {
      return found(away(OPPOSITE) < AT_OPPOSITE * speed ? "the opposite velocity" : "a faster one");
    }
    const rest = valueAt([0, 0, 0]);
    if (speed > SLOW && away(SLOWER) < AT_SLOWER * speed && rest - other.value > TELLING) {
      return found("a 3.6 times slower one");
    }
    return [];
  }

  /** Whether in most intervals the positions alone fit another velocity clearly better. */
  function ofContradiction({ model, ...track }) {
    const known = accepted(track);
    if (known.length < FEW) return [];
    const count = Math.min(SAMPLE, known.length),
      spread = Array.from({ length: count }, (_, i) =>
        i === count - 1 ? known.length - 1 : Math.trunc(i * ((known.length - 1) / (count - 1))),
      ),
      step = Math.floor(count / FEW),
      order = Array.from({ length: step }, (_, first) => spread.filter((_, i) => i % step === first)).flat();
    const against = [];
    let compared = 0;
    for (const i of order) {
      if (compared === FEW && against.length < 2) return [];
      compared += 1;
      against.push(...contradictionOf(problemOf(known[i].pairs, model), known[i].row.theta));
    }
    const times = (kind) => against.filter((each) => each.kind === kind).length,
      kind = Object.keys(SYMPTOMS).reduce((best, each) => (times(each) > times(best) ? each : best)),
      together = (some) => Math.hypot(...[0, 1].map((axis) => some.reduce((total, { heading }) => total + heading[axis], 0)));
    // a fit by chance has a random direction, and must not hide what most say
    const most = Math.max(together(against), together(against.filter((each) => each.kind === kind)));
    if (2 * most <= compared) return [];
    const told =
      `in ${against.length} of ${compared} intervals the positions fit another velocity better, mostly ${kind}`;
    return [finding(SYMPTOMS[kind], "", against.length / compared, "share", true, told)];
  }

  // ---- d2d/radar/trust/findings.py -----------------------------------------------------------------------------------------

  const NARROW = 3.5 * DEGREE,
    FAR = 500, // m
    PRECISE = 0.03 * DEGREE,
    COARSE = 10 * DEGREE,
    TOO_SMALL = "standard deviation of the azimuth too small",
    TOO_LARGE = "standard deviation of the azimuth too large",
    MOVING = 3, // m/s
    SEEN = 5; // targets of a scan, and scans
  const TURNED = 1.5 * DEGREE,
    GROSS = 15 * DEGREE,
    ALIKE_HEADINGS = 12 * DEGREE,
    SURE_HEADING = 4, // standard deviations
    LEVER = 1.5, // m
    UNKNOWN = 1 * DEGREE,
    ALIKE_SCANS = 10;
  const FEW_FIT = 0.4,
    HARDLY_ANY = 0.05,
    GAP = 1, // s
    CYCLES = 5,
    ASIDE = [50 * DEGREE, 130 * DEGREE],
    SLIPPING = 0.05; // m/s
  const FOLD = 1.6,
    STEADY = 0.2,
    FOLDED = 0.05,
    BACKWARDS = "the vehicle drives backwards",
    CLOCKWISE = "azimuths count clockwise";

  /** Median over accepted rounds of each sensor's mean inlier probability, by the sensors' numbers. */
  function inliersOf({ model, sensors, ...track }) {
    const shares = sensors.map(() => []);
    for (const { row, pairs } of evenly(accepted(track))) {
      for (const pair of pairs) {
        shares[pair.sensor].push(mean(d2d.evaluate(problemOf([pair], model), row.theta).shares));
      }
    }
    return shares.map((own) => (own.length ? median(own) : NaN));
  }

  /** The yaw rate of a track at another time; nan where it is not known. */
  function yawRateAt(rows, time, longest) {
    const found = d2d.neighbours(rows, time, longest);
    return found ? (1 - found.weight) * found.earlier.theta[2] + found.weight * found.later.theta[2] : NaN;
  }

  /** The direction in which the vehicle seems to drive by a sensor's Doppler velocities, {heading, sigma}. */
  function headingOf({ scans, mounting }, rows) {
    const nothing = { heading: NaN, sigma: NaN },
      longest = d2d.longestGap(rows);
    let seen = evenly(scans)
      .filter((scan) => scan.targets.length >= SEEN)
      .map((scan) => ({ scan, omega: yawRateAt(rows, scan.time, longest) }));
    if (!seen.length) return nothing;
    const known = seen.filter(({ omega }) => Number.isFinite(omega));
    seen = known.length >= SEEN ? known : seen.map((each) => ({ ...each, omega: 0 }));
    const turning = seen.some(({ omega }) => omega !== 0);
    const fast = seen
      .map(({ scan, omega }) => {
        const [x, y] = sensorFit(scan, mounting).velocity,
          own = [x + omega * mounting.y, y - omega * mounting.x],
          speed = Math.hypot(...own);
        return { speed, unit: own.map((each) => each / speed), bend: omega / speed };
      })
      .filter(({ speed }) => speed > MOVING);
    if (fast.length < SEEN) return nothing;
    const [ahead, left] = [0, 1].map((axis) => median(fast.map(({ unit }) => unit[axis]))),
      middle = Math.atan2(left, ahead),
      off = fast.map(({ unit }) => wrapped(Math.atan2(unit[1], unit[0]) - middle)),
      centre = median(off),
      spread = Math.max(1.4826 * median(off.map((each) => Math.abs(each - centre))), 0.1 * DEGREE);
    const near = fast.map(({ bend }, k) => ({ bend, off: off[k] })).filter((each) => Math.abs(each.off - centre) < 5 * spread),
      weight = 1 / (ALIKE_SCANS * spread ** 2),
      total = (of) => weight * near.reduce((sum, each) => sum + of(each), 0);
    // least squares of a constant and a lever arm, whose size is known beforehand
    const ones = weight * near.length,
      crossed = total(({ bend }) => bend),
      squares = total(({ bend }) => bend ** 2) + LEVER ** -2,
      determinant = ones * squares - crossed ** 2,
      right = [total((each) => each.off), total((each) => each.off * each.bend)];
    const constant = (squares * right[0] - crossed * right[1]) / determinant;
    return {
      heading: wrapped(middle + constant),
      sigma: Math.hypot(Math.sqrt(squares / determinant), turning ? 0 : UNKNOWN),
    };
  }

  /** What the targets of a sensor tell without any estimate. */
  function ofTargets({ name, scans }) {
    const targets = scans.flatMap((scan) => scan.targets),
      found = [];
    if (targets.length < 10 * SEEN) return found;
    const tell = (symptom, number, unit, sure, about) => found.push(finding(symptom, name, number, unit, sure, about));
    const widest = greatest(targets.map(({ azimuth }) => Math.abs(azimuth))) / DEGREE;
    if (widest * DEGREE < NARROW) {
      const told = `all azimuths are within ${widest.toFixed(2)} deg of the boresight`;
      tell("azimuths in radians, read as degrees", widest, "deg", true, told);
    }
    const distance = median(targets.map(({ range }) => range));
    if (distance > FAR) tell("ranges in cm", distance, "m", true, `half of them are beyond ${distance.toFixed(0)} m`);
    const single = mean(scans.map((scan) => (scan.targets.length <= 1 ? 1 : 0)));
    if (single > 0.9) {
      const told = `${percent(single)} of its scans have one target; all targets of a scan need the same time`;
      tell("one time stamp for each target", single, "share", true, told);
    }
    const { limit, share } = foldedOf(scans);
    if (limit > MOVING && share > FOLDED) {
      const told = `neighbours differ by nearly twice ${limit.toFixed(1)} m/s in ${percent(share)} of the scans`;
      tell("Doppler velocities are folded", limit, "m/s", true, told);
    }
    const sigma = median(targets.map(({ sigmaAzimuth }) => sigmaAzimuth));
    const degrees = sigma / DEGREE;
    if (sigma < PRECISE) {
      tell(TOO_SMALL, degrees, "deg", false, `${Number(degrees.toPrecision(2))} deg is stated; is this rad?`);
    } else if (sigma > COARSE) {
      tell(TOO_LARGE, degrees, "deg", false, `${degrees.toFixed(0)} deg is stated; are these degrees?`);
    }
    return found;
  }

  /** The largest Doppler velocity, and the share of scans in which it is folded. */
  function foldedOf(scans) {
    const seen = scans.filter((scan) => scan.targets.length >= SEEN),
      limit = greatest(seen.flatMap((scan) => scan.targets.map(({ doppler }) => Math.abs(doppler))));
    const folded = seen.filter(({ targets }) => {
      const ordered = [...targets].sort((a, b) => a.azimuth - b.azimuth),
        steps = ordered.slice(1).map(({ doppler }, k) => Math.abs(doppler - ordered[k].doppler)),
        isSteady = (step) => step < STEADY * limit;
      return steps.some((step, k) => step > FOLD * limit && k && k < steps.length - 1 && isSteady(steps[k - 1]) && isSteady(steps[k + 1]));
    });
    return { limit, share: seen.length ? folded.length / seen.length : 0 };
  }

  /** Which mistake with the mountings explains the headings that the sensors show. */
  function ofMountings(shown) {
    const known = shown.filter(({ heading }) => Number.isFinite(heading)),
      headings = known.map(({ heading }) => heading),
      told = (degrees, decimals) => `Doppler velocities show a drive at ${signed(degrees, decimals)} deg from straight ahead`;
    if (greatest(headings.map(Math.abs)) > GROSS) {
      const worst = headings.reduce((a, b) => (Math.abs(b) > Math.abs(a) ? b : a)) / DEGREE;
      const rest = mistakesOf(known).map((each) => ({
        ...each,
        misfit: greatest(headings.map((heading, i) => Math.abs(wrapped(heading - each.turn[i])))),
      }));
      const least = Math.min(...rest.map(({ misfit }) => misfit));
      if (least < ALIKE_HEADINGS) {
        // a vehicle may reverse, but then the positions say the same
        const contradicted = usualShare(shown) < FEW_FIT,
          isSure = (symptom) => symptom !== BACKWARDS || contradicted;
        return rest
          .filter(({ misfit }) => misfit < least + TURNED)
          .map(({ symptom, sensor }) => finding(symptom, sensor, worst, "deg", isSure(symptom), told(worst, 0)));
      }
    }
    let off = known.filter(({ heading, sigma }) => Math.abs(heading) > Math.max(TURNED, SURE_HEADING * sigma));
    if (known.length > 1 && off.length === known.length && Math.max(...headings) - Math.min(...headings) < TURNED) {
      off = [{ ...off[0], name: "", heading: mean(headings) }]; // all by the same angle
    }
    return off.map(({ name, heading }) =>
      finding("a mounting is turned", name, heading / DEGREE, "deg", Math.abs(heading) > GROSS, told(heading / DEGREE, 1)),
    );
  }

  /** Mistakes, with the sensors they are about, and the heading that each then shows. */
  function mistakesOf(known) {
    const yaws = known.map(({ mounting }) => mounting.yaw),
      found = [
        { symptom: BACKWARDS, sensor: "", turn: yaws.map(() => Math.PI) },
        { symptom: CLOCKWISE, sensor: "", turn: yaws.map((yaw) => 2 * yaw) },
      ];
    if (greatest(yaws.map(Math.abs)) < 2 * Math.PI * DEGREE) {
      found.push({ symptom: "yaw of the mountings in radians", sensor: "", turn: yaws.map((yaw) => yaw - yaw / DEGREE) });
    }
    if (known.length < 2) return found;
    known.forEach(({ name }, i) => {
      found.push({ symptom: CLOCKWISE, sensor: name, turn: yaws.map((yaw, j) => (i === j ? 2 * yaw : 0)) });
    });
    known.forEach((first, i) => {
      for (let j = i + 1; j < known.length; j++) {
        const turn = yaws.map((_, k) => (k === i ? yaws[i] - yaws[j] : k === j ? yaws[j] - yaws[i] : 0));
        found.push({ symptom: "sensors are swapped", sensor: `${first.name} and ${known[j].name}`, turn });
      }
    });
    return found;
  }

  /** What is sure where any motion is accepted. */
  function withoutLimits(track) {
    const model = { ...track.model, prior: [0, 0, 0] },
      follower = new tracker.Follower(model, null, null),
      free = { ...track, model, rows: track.rounds.map((round) => follower.follow(round)) };
    return [...ofLateness(free), ...ofContradiction(free)].filter(({ sure }) => sure);
  }

  /** Median of the sensors' inlier shares; nan if none is known. */
  function usualShare(shown) {
    const shares = shown.map(({ inliers }) => inliers).filter(Number.isFinite);
    return shares.length ? median(shares) : NaN;
  }

  /** What inlier shares, times and covariances tell. */
  function ofTrack(shown, rows) {
    const found = [],
      share = usualShare(shown);
    if (share < FEW_FIT) {
      const told = `${percent(share)} of the targets fit; units, signs, standard deviations, clocks`;
      found.push(finding("few targets fit", "", share, "share", false, told));
    } else if (shown.filter(({ inliers }) => Number.isFinite(inliers)).length > 1) {
      for (const { name, inliers } of shown.filter((each) => each.inliers < HARDLY_ANY)) {
        const told = `${percent(inliers)} of its targets fit the motion that the others show`;
        found.push(finding("few targets fit", name, inliers, "share", false, told));
      }
    }
    const widest = rows.reduce((a, b) => (b.interval > a.interval ? b : a));
    if (widest.interval > Math.max(GAP, CYCLES * median(rows.map((row) => row.interval)))) {
      const told = `${widest.interval.toFixed(1)} s before ${widest.time.toFixed(3)} s; the path goes on with the last velocity`;
      found.push(finding("a gap", "", widest.interval, "s", false, told));
    }
    const sigmas = rows.filter((row) => !row.reason).map((row) => Math.sqrt(row.covariance[1][1]));
    if (shown.length === 1 && sigmas.length && median(sigmas) > SLIPPING) {
      const [{ name, mounting }] = shown,
        yaw = Math.abs(wrapped(mounting.yaw));
      if (ASIDE[0] < yaw && yaw < ASIDE[1]) {
        const told = `it looks ${(yaw / DEGREE).toFixed(0)} deg aside; --side-slip, or more sensors`;
        found.push(finding("one radar to the side", name, yaw / DEGREE, "deg", false, told));
      }
    }
    return found;
  }

  /** What is probably wrong with a log, {found, inliers}, from what `tracker.track` returns; inliers by sensor. */
  function diagnose(track) {
    const { sensors, rows } = track,
      inliers = inliersOf(track),
      shown = sensors.map((sensor, s) => ({ ...sensor, inliers: inliers[s], ...headingOf(sensor, rows) })),
      few = usualShare(shown) < FEW_FIT,
      targets = sensors.flatMap(ofTargets).map((each) => ({ ...each, sure: each.sure || (few && each.symptom === TOO_SMALL) }));
    const said = [...track.found, ...ofLateness(track), ...ofContradiction(track), ...targets];
    // what is wrong with targets explains the rest
    if (!targets.some((each) => each.sure)) {
      if (accepted(track).length < FEW) said.push(...withoutLimits(track));
      said.push(...ofMountings(shown));
    }
    return { inliers, found: [...said, ...ofTrack(shown, rows)] };
  }

  // ---- d2d/radar/trust/halves.py -------------------------------------------------------------------------------------------

  const ENOUGH = 4; // estimates at common times

  /** ANEES of the differences between two tracks, see `compare_tracks`; nan if they have too little in common. */
  function aneesOf(first, second) {
    const { errors, covariances } = d2d.differences(first, second);
    return (errors.length >= ENOUGH && d2d.credibility(errors, covariances)?.anees) || NaN;
  }

  /** {sensors, anees} of each two sensors that have a track of their own. */
  const agreements = ({ alone }) =>
    alone.flatMap((first, i) =>
      alone.slice(i + 1).map((second) => ({
        sensors: `${first.name} and ${second.name}`,
        anees: aneesOf(first.rows, second.rows),
      })),
    );

  return { agreements, diagnose, source: String(radarFindings) };
})();
