// Registration of point sets in the browser: the cost of the package d2d, its exact derivatives, its optimum and the
// credibility of its covariance, for the laboratories in the pages.  tests/book/test_engine.py compares all of it with
// d2d, to 1e-9.
//
// A classic script, so that a book opened from a folder (file://) can load it; it defines one name, `d2d`.
// `import "./engine.js"` in a module does the same.
//
// Conventions are those of d2d.  `fixed` is the previous scan, `moving` the current one; a motion [t_x, t_y, phi] in m, m,
// rad maps moving onto fixed.  A velocity [v_x, v_y, omega] causes the motion exp(interval * velocity).  A target is
// {x, y, xx, xy, yy}: its mean (m) and covariance (m^2).  A problem is
//   {fixed, moving,               // arrays of targets
//    fusion: "likelihood",        // or "summing"
//    outlier: null,               // or {fraction, xx, xy, yy}: a corrupted Gaussian
//    interval: null,              // s: the parameters are a velocity; null: they are the motion itself
//    dopplerWidth: 4,             // m/s: an outlier's Doppler velocity is uniform over this width
//    line: false}                 // true: targets on a line, of which only x and xx count
// A moving target may have `doppler`, see `dopplerMeasurement`; a target with `count` stands for so many equal ones.
// Several sensors share one velocity: {pairs} is the sum of such problems.
globalThis.d2d = (function engine() {
  "use strict";

  const LOG_2PI = Math.log(2 * Math.PI);
  const GATE = 36; // exp(-36) = 2e-16: a term so far below the largest changes nothing
  const UNIT_VARIANCE = 1 / (2 * Math.PI); // a Gaussian of this variance has the density 1 at its mean

  // ---- Densities with their derivatives --------------------------------------------------------------------------------
  //
  // A "jet" is the logarithm of a density with its first and second derivatives in the three parameters:
  // [log, g0, g1, g2, h00, h01, h02, h11, h12, h22].  Densities are multiplied by adding jets and mixed by `mix`.

  /** The jet of a product of densities. */
  const product = (jets) => jets.reduce((sum, jet) => sum.map((s, i) => s + jet[i]), new Array(10).fill(0));

  /** As many densities as `count` multiplied. */
  const power = (jet, count) => jet.map((each) => count * each);

  /** The logarithm of each component's weight; weights sum to one. */
  function logWeights(targets) {
    const total = targets.reduce((sum, target) => sum + (target.count ?? 1), 0);
    return targets.map((target) => Math.log((target.count ?? 1) / total));
  }

  const largest = (values) => values.reduce((a, b) => Math.max(a, b), -Infinity);

  /** The jet of a sum of densities: log-sum-exp; the curvatures are averaged and the gradients' scatter added. */
  function mix(jets) {
    const top = largest(jets.map((jet) => jet[0]));
    const near = jets.filter((jet) => jet[0] >= top - GATE);
    const weights = near.map((jet) => Math.exp(jet[0] - top));
    const total = weights.reduce((a, b) => a + b, 0);
    const mixed = new Array(10).fill(0);
    near.forEach((jet, j) => {
      for (let i = 1; i < 4; i++) mixed[i] += (weights[j] / total) * jet[i];
    });
    near.forEach((jet, j) => {
      const [a, b, c] = [jet[1] - mixed[1], jet[2] - mixed[2], jet[3] - mixed[3]];
      const scatter = [a * a, a * b, a * c, b * b, b * c, c * c];
      for (let i = 0; i < 6; i++) mixed[4 + i] += (weights[j] / total) * (jet[4 + i] + scatter[i]);
    });
    mixed[0] = top + Math.log(total);
    return mixed;
  }

  // ---- One moving target and one fixed component -------------------------------------------------------------------------

  /** A target turned by an angle: its mean p and covariance C in the directions of the fixed set. */
  function turned(target, cosine, sine) {
    const { x, y, xx, xy, yy } = target;
    return {
      x: cosine * x - sine * y,
      y: sine * x + cosine * y,
      xx: cosine * cosine * xx - 2 * cosine * sine * xy + sine * sine * yy,
      xy: cosine * sine * (xx - yy) + (cosine * cosine - sine * sine) * xy,
      yy: sine * sine * xx + 2 * cosine * sine * xy + cosine * cosine * yy,
    };
  }

  /** S = R Sigma_k R' + Sigma_i of a pair. */
  function spread(p, component, line) {
    const yy = line ? UNIT_VARIANCE : component.yy + p.yy;
    return { xx: component.xx + p.xx, xy: line ? 0 : component.xy + p.xy, yy };
  }

  /** S of the corrupted Gaussian, the same for all pairs. */
  function outlierSpread({ outlier, line }) {
    return line ? { xx: outlier.xx, xy: 0, yy: UNIT_VARIANCE } : { xx: outlier.xx, xy: outlier.xy, yy: outlier.yy };
  }

  /** The fixed components as columns, which a pass over all pairs reads fastest; `weight` is a logarithm. */
  function columnsOf(fixed) {
    const column = (name) => Float64Array.from(fixed, (component) => component[name]);
    const [x, y, xx, xy, yy] = ["x", "y", "xx", "xy", "yy"].map(column);
    return { count: fixed.length, x, y, xx, xy, yy, weight: Float64Array.from(logWeights(fixed)), logs: column("x") };
  }

  /**
   * The jet of a target's position under all components: of its inlier density or, with the spread `wide` of all pairs, of
   * its outlier density.
   *
   * With d = p + t - mu, B = S^-1 and u = B d, the gradient of log N(0 | d, S) is [-u, g2].  S turns with the target unless
   * it is wide: dS/dphi = C_phi.
   */
  function positionJet(p, tx, ty, components, line, wide) {
    const { count, x, y, xx, xy, yy, weight, logs } = components,
      own = wide ? 0 : 1,
      turning = own && !line ? 1 : 0;
    // first and second derivative of S in the angle: [[-2b, a], [a, 2b]] and [[-2a, -4b], [-4b, 2a]]
    const a = turning * (p.xx - p.yy),
      b = turning * p.xy;
    let top = -Infinity;
    for (let i = 0; i < count; i++) {
      const dx = p.x + tx - x[i],
        dy = line ? 0 : p.y + ty - y[i];
      const sxx = (wide ? wide.xx : xx[i]) + own * p.xx,
        sxy = line ? 0 : (wide ? wide.xy : xy[i]) + own * p.xy,
        syy = line ? UNIT_VARIANCE : (wide ? wide.yy : yy[i]) + own * p.yy;
      const determinant = sxx * syy - sxy * sxy,
        square = (syy * dx * dx - 2 * sxy * dx * dy + sxx * dy * dy) / determinant;
      logs[i] = weight[i] - 0.5 * (square + Math.log(determinant)) - LOG_2PI;
      if (logs[i] > top) top = logs[i];
    }
    let total = 0;
    const mixed = new Array(10).fill(0);
    for (let i = 0; i < count; i++) {
      if (logs[i] < top - GATE) continue;
      const dx = p.x + tx - x[i],
        dy = line ? 0 : p.y + ty - y[i];
      const sxx = (wide ? wide.xx : xx[i]) + own * p.xx,
        sxy = line ? 0 : (wide ? wide.xy : xy[i]) + own * p.xy,
        syy = line ? UNIT_VARIANCE : (wide ? wide.yy : yy[i]) + own * p.yy;
      const determinant = sxx * syy - sxy * sxy;
      const bxx = syy / determinant,
        bxy = -sxy / determinant,
        byy = sxx / determinant;
      const ux = bxx * dx + bxy * dy,
        uy = bxy * dx + byy * dy;
      const cux = -2 * b * ux + a * uy,
        cuy = a * ux + 2 * b * uy; // C_phi u
      const vx = -p.y - cux,
        vy = p.x - cuy; // v = d_phi - C_phi u
      const bvx = bxx * vx + bxy * vy,
        bvy = bxy * vx + byy * vy;
      // M = B C_phi, for the derivatives of the determinant
      const m00 = -2 * b * bxx + a * bxy,
        m01 = a * bxx + 2 * b * bxy;
      const m10 = -2 * b * bxy + a * byy,
        m11 = a * bxy + 2 * b * byy;
      const g2 = ux * p.y - uy * p.x + 0.5 * (ux * cux + uy * cuy) - 0.5 * (m00 + m11);
      const bent = -a * ux * ux - 4 * b * ux * uy + a * uy * uy; // u' C_phiphi u / 2
      const trace = -2 * a * bxx - 8 * b * bxy + 2 * a * byy; // of B C_phiphi
      const h22 =
        -(vx * bvx + vy * bvy) + ux * p.x + uy * p.y + bent + 0.5 * (m00 * m00 + 2 * m01 * m10 + m11 * m11) - 0.5 * trace;
      const share = Math.exp(logs[i] - top);
      total += share;
      mixed[1] -= share * ux;
      mixed[2] -= share * uy;
      mixed[3] += share * g2;
      mixed[4] += share * (ux * ux - bxx);
      mixed[5] += share * (ux * uy - bxy);
      mixed[6] -= share * (ux * g2 + bvx);
      mixed[7] += share * (uy * uy - byy);
      mixed[8] -= share * (uy * g2 + bvy);
      mixed[9] += share * (g2 * g2 + h22);
    }
    for (let i = 1; i < 10; i++) mixed[i] /= total;
    const [, g0, g1, g2] = mixed; // what was added up are squares about zero
    [g0 * g0, g0 * g1, g0 * g2, g1 * g1, g1 * g2, g2 * g2].forEach((square, i) => (mixed[4 + i] -= square));
    mixed[0] = top + Math.log(total);
    return mixed;
  }

  // ---- Velocities ------------------------------------------------------------------------------------------------------

  /**
   * The motion exp(twist) with its derivatives: the Jacobian [[a, b, c], [-b, a, d], [0, 0, 1]], the derivatives a1, b1 of
   * a, b along the angle w, and the second derivative (e, f) of (x, y) along it.
   */
  function exponential(x, y, w) {
    // p + iq = (exp(iw) - 1) / (iw) and its two derivatives
    let p = 0,
      q = 0,
      p1 = 0,
      q1 = 0,
      p2 = 0,
      q2 = 0;
    if (Math.abs(w) < 0.3) {
      // sum of (iw)^k / (k + 1)!, by Horner's rule
      for (let k = 12; k >= 0; k--) {
        let factorial = 1;
        for (let i = 2; i <= k + 1; i++) factorial *= i;
        const [even, odd] = [
          [1, 0],
          [0, 1],
          [-1, 0],
          [0, -1],
        ][k % 4];
        p2 = p2 * w + 2 * p1;
        q2 = q2 * w + 2 * q1;
        p1 = p1 * w + p;
        q1 = q1 * w + q;
        p = p * w + even / factorial;
        q = q * w + odd / factorial;
      }
    } else {
      const cosine = Math.cos(w),
        sine = Math.sin(w);
      p = sine / w;
      q = (1 - cosine) / w;
      p1 = (cosine - p) / w;
      q1 = (sine - q) / w;
      p2 = (-sine - 2 * p1) / w;
      q2 = (cosine - 2 * q1) / w;
    }
    return {
      motion: [p * x - q * y, p * y + q * x, w],
      a: p,
      b: -q,
      c: p1 * x - q1 * y,
      d: p1 * y + q1 * x,
      a1: p1,
      b1: -q1,
      e: p2 * x - q2 * y,
      f: p2 * y + q2 * x,
    };
  }

  /** Chain rule: a jet in the motion becomes one in the velocity. */
  function inVelocity(jet, chart, interval) {
    const [log, g0, g1, g2, h00, h01, h02, h11, h12, h22] = jet;
    const { a, b, c, d, a1, b1, e, f } = chart;
    const m00 = h00 * a - h01 * b,
      m10 = h01 * a - h11 * b;
    const m01 = h00 * b + h01 * a,
      m11 = h01 * b + h11 * a;
    const m02 = h00 * c + h01 * d + h02,
      m12 = h01 * c + h11 * d + h12,
      m22 = h02 * c + h12 * d + h22;
    const square = interval * interval;
    return [
      log,
      interval * (a * g0 - b * g1),
      interval * (b * g0 + a * g1),
      interval * (c * g0 + d * g1 + g2),
      square * (a * m00 - b * m10),
      square * (a * m01 - b * m11),
      square * (a * m02 - b * m12 + a1 * g0 - b1 * g1),
      square * (b * m01 + a * m11),
      square * (b * m02 + a * m12 + b1 * g0 + a1 * g1),
      square * (c * m02 + d * m12 + m22 + e * g0 + f * g1),
    ];
  }

  /** The Doppler velocity of a static target is gain' velocity (m/s, positive when receding); slope: along the azimuth. */
  function dopplerGradients(azimuth, mounting) {
    const cosine = Math.cos(azimuth + mounting.yaw),
      sine = Math.sin(azimuth + mounting.yaw);
    return {
      gain: [-cosine, -sine, mounting.y * cosine - mounting.x * sine],
      slope: [sine, -cosine, -mounting.y * sine - mounting.x * cosine],
    };
  }

  /** A measured Doppler velocity (m/s) of a target at `azimuth` (rad) in the sensor's frame. */
  function dopplerMeasurement(value, azimuth, sigma, sigmaAzimuth, mounting) {
    const { gain, slope } = dopplerGradients(azimuth, mounting);
    return { value, variance: sigma ** 2, inputVariance: sigmaAzimuth ** 2, gain, slope };
  }

  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

  /** The jet of log N(value | gain' theta, variance + input variance (slope' theta)^2) in the velocity theta. */
  function dopplerJet({ value, variance, inputVariance, gain, slope }, theta) {
    const residual = value - dot(gain, theta),
      along = dot(slope, theta);
    const total = variance + inputVariance * along * along;
    const e = residual / total;
    const dv = 2 * inputVariance * along; // d total / d theta = dv slope
    const first = 0.5 * (e * e - 1 / total);
    const hh = -1 / total,
      hs = (-e / total) * dv;
    const ss = first * 2 * inputVariance - ((e * e - 0.5 / total) / total) * dv * dv;
    const jet = [-0.5 * (residual * e + Math.log(total) + LOG_2PI)];
    for (let i = 0; i < 3; i++) jet.push(e * gain[i] + first * dv * slope[i]);
    for (let i = 0; i < 3; i++) {
      for (let j = i; j < 3; j++) {
        jet.push(hh * gain[i] * gain[j] + hs * (gain[i] * slope[j] + slope[i] * gain[j]) + ss * slope[i] * slope[j]);
      }
    }
    return jet;
  }

  // ---- The cost ----------------------------------------------------------------------------------------------------------

  /** The jets of all moving targets, each with the inlier's share in its density. */
  function targetJets(problem, theta) {
    const { interval = null, outlier = null, line } = problem;
    const chart = interval === null ? null : exponential(...theta.map((each) => interval * each));
    const [tx, ty, phi] = chart ? chart.motion : theta;
    const cosine = Math.cos(phi),
      sine = Math.sin(phi);
    const components = columnsOf(problem.fixed),
      wide = outlier && outlierSpread(problem);
    const own = (jet) => (chart ? inVelocity(jet, chart, interval) : jet);
    return problem.moving.map((target) => {
      const p = turned(target, cosine, sine);
      let inlier = own(positionJet(p, tx, ty, components, line, null));
      if (target.doppler) inlier = product([inlier, dopplerJet(target.doppler, theta)]);
      if (!outlier) return { jet: inlier, share: 1 };
      inlier[0] += Math.log1p(-outlier.fraction);
      const other = own(positionJet(p, tx, ty, components, line, wide));
      other[0] += Math.log(outlier.fraction);
      if (target.doppler) other[0] -= Math.log(problem.dopplerWidth ?? 4);
      const share = 1 / (1 + Math.exp(other[0] - inlier[0]));
      return { jet: mix([inlier, other]), share };
    });
  }

  /** What is minimised, at theta: {value, gradient, hessian, logs, shares}; logs are log q_k of each target. */
  function evaluate(problem, theta) {
    return problem.pairs ? evaluateTogether(problem, theta) : evaluatePair(problem, theta);
  }

  /** The sum of the costs of several pairs. */
  function evaluateTogether({ pairs }, theta) {
    const parts = pairs.map((pair) => evaluatePair(pair, theta)),
      sum = (of) => parts.reduce((total, part) => total + of(part), 0);
    return {
      value: sum((part) => part.value),
      gradient: theta.map((_, i) => sum((part) => part.gradient[i])),
      hessian: theta.map((_, i) => theta.map((_, j) => sum((part) => part.hessian[i][j]))),
      logs: parts.flatMap((part) => part.logs),
      shares: parts.flatMap((part) => part.shares),
    };
  }

  function evaluatePair(problem, theta) {
    const targets = targetJets(problem, theta);
    const jets = targets.map((target) => target.jet),
      counts = problem.moving.map((target) => target.count ?? 1);
    const fused =
      problem.fusion === "summing"
        ? mix(jets.map(([log, ...rest], k) => [log + Math.log(counts[k]), ...rest]))
        : product(jets.map((jet, k) => power(jet, counts[k])));
    const [value, g0, g1, g2, h00, h01, h02, h11, h12, h22] = fused.map((each) => -each);
    const result = { value, logs: jets.map((jet) => jet[0]), shares: targets.map((target) => target.share) };
    return problem.line // t_y and phi do not exist: a unit curvature keeps the step along them at zero
      ? {
          ...result,
          gradient: [g0, 0, 0],
          hessian: [
            [h00, 0, 0],
            [0, 1, 0],
            [0, 0, 1],
          ],
        }
      : {
          ...result,
          gradient: [g0, g1, g2],
          hessian: [
            [h00, h01, h02],
            [h01, h11, h12],
            [h02, h12, h22],
          ],
        };
  }

  /** The cost over a grid of translations at one angle, row by row of `ys`: as `evaluate`, without derivatives. */
  function surface(problem, xs, ys, phi) {
    const { fixed, moving, outlier = null } = problem;
    const cosine = Math.cos(phi),
      sine = Math.sin(phi),
      n = fixed.length,
      weights = logWeights(fixed);
    const summing = problem.fusion === "summing";
    const values = new Float64Array(xs.length * ys.length).fill(summing ? -Infinity : 0);
    const inside = outlier ? Math.log1p(-outlier.fraction) : 0;
    const parts = new Float64Array(2 * n);
    for (const target of moving) {
      const p = turned(target, cosine, sine);
      // where each component would have to be moved from, the three precisions, and the logarithm at its peak
      const pairs = [];
      for (const wide of outlier ? [null, outlierSpread(problem)] : [null]) {
        for (const [i, component] of fixed.entries()) {
          const s = wide ?? spread(p, component, problem.line);
          const determinant = s.xx * s.yy - s.xy * s.xy;
          pairs.push([
            component.x - p.x,
            component.y - p.y,
            s.yy / determinant,
            -s.xy / determinant,
            s.xx / determinant,
            -0.5 * Math.log(determinant) - LOG_2PI + weights[i] + (wide ? Math.log(outlier.fraction) : inside),
          ]);
        }
      }
      const count = target.count ?? 1;
      let cell = 0;
      for (const ty of ys) {
        for (const tx of xs) {
          let top = -Infinity;
          for (let j = 0; j < pairs.length; j++) {
            const pair = pairs[j],
              dx = tx - pair[0],
              dy = ty - pair[1];
            parts[j] = pair[5] - 0.5 * (pair[2] * dx * dx + 2 * pair[3] * dx * dy + pair[4] * dy * dy);
            if (parts[j] > top) top = parts[j];
          }
          let sum = 0;
          for (let j = 0; j < pairs.length; j++) if (parts[j] > top - 30) sum += Math.exp(parts[j] - top);
          const log = top + Math.log(sum),
            before = values[cell];
          if (summing) {
            const higher = Math.max(before, log);
            values[cell] = higher + Math.log(Math.exp(before - higher) + count * Math.exp(log - higher));
          } else values[cell] = before + count * log;
          cell += 1;
        }
      }
    }
    return values.map((value) => -value);
  }

  // ---- Newton's method in a trust region, step for step that of d2d ------------------------------------------------------

  const SINGULAR = 1e-8; // a pivot below this part of its diagonal counts as zero
  const TOLERANCE = 1e-14,
    RESOLVED = 1e-8,
    ROUNDING = 2e-15,
    MAX_ITERATIONS = 200;

  /** Solve (H + shift diag(scale)) step = -g by L D L'; null unless positive definite; `slope` as the search needs it. */
  function shiftedSolve(h, g, shift, scale) {
    const d0 = h[0][0] + shift * scale[0];
    if (!(d0 > SINGULAR * Math.abs(h[0][0]))) return null;
    const l10 = h[1][0] / d0,
      l20 = h[2][0] / d0;
    const d1 = h[1][1] + shift * scale[1] - l10 * h[1][0];
    if (!(d1 > SINGULAR * Math.abs(h[1][1]))) return null;
    const e21 = h[2][1] - l20 * h[1][0],
      l21 = e21 / d1;
    const d2 = h[2][2] + shift * scale[2] - l20 * h[2][0] - l21 * e21;
    if (!(d2 > SINGULAR * Math.abs(h[2][2]))) return null;
    const y0 = -g[0],
      y1 = -g[1] - l10 * y0,
      y2 = -g[2] - l20 * y0 - l21 * y1;
    const s2 = y2 / d2,
      s1 = y1 / d1 - l21 * s2,
      s0 = y0 / d0 - l10 * s1 - l20 * s2;
    const z0 = scale[0] * s0,
      z1 = scale[1] * s1 - l10 * z0,
      z2 = scale[2] * s2 - l20 * z0 - l21 * z1;
    return { step: [s0, s1, s2], slope: (z0 * z0) / d0 + (z1 * z1) / d1 + (z2 * z2) / d2 };
  }

  /** The inverse of a positive definite 3 x 3 matrix; null if it is not. */
  function inverse3(h) {
    const columns = [
      [-1, 0, 0],
      [0, -1, 0],
      [0, 0, -1],
    ].map((unit) => shiftedSolve(h, unit, 0, [1, 1, 1])?.step);
    if (!columns[0]) return null;
    return [0, 1, 2].map((i) => [0, 1, 2].map((j) => columns[Math.min(i, j)][Math.max(i, j)]));
  }

  const times = (h, v) => h.map((row) => dot(row, v));
  const lengthIn = (scale, v) => Math.sqrt(scale[0] * v[0] ** 2 + scale[1] * v[1] ** 2 + scale[2] * v[2] ** 2);
  const decrease = (h, g, step) => -dot(step, g) - 0.5 * dot(step, times(h, step));

  /** The hard case of an indefinite Hessian: go on along its lowest eigenvector, to the trust region's boundary. */
  function toBoundary(h, g, shift, scale, radius, generic, step) {
    const length = lengthIn(scale, step);
    if (shiftedSolve(h, g, 0, scale) || length >= 0.9 * radius) return step;
    const along = shiftedSolve(
      h,
      generic.map((each, i) => each * Math.sqrt(scale[i])),
      shift,
      scale,
    )?.step;
    if (!along) return step;
    const size = lengthIn(scale, along);
    const onStep = along.reduce((sum, a, i) => sum + a * scale[i] * step[i], 0) / size;
    const root = Math.sqrt(onStep * onStep + radius * radius - length * length);
    const forward = step.map((s, i) => s + ((root - onStep) / size) * along[i]);
    const backward = step.map((s, i) => s - ((root + onStep) / size) * along[i]);
    return decrease(h, g, forward) > decrease(h, g, backward) ? forward : backward;
  }

  /** Minimise the quadratic model within the radius (More & Sorensen 1983). */
  function trustRegionStep(h, g, scale, radius, generic) {
    let low = 0,
      high = 0;
    for (let i = 0; i < 3; i++) {
      let off = 0;
      for (let j = 0; j < 3; j++) if (j !== i) off += Math.abs(h[i][j]) / Math.sqrt(scale[i] * scale[j]);
      low = Math.max(low, -h[i][i] / scale[i]);
      high = Math.max(high, Math.abs(h[i][i] / scale[i]) + off);
    }
    high += Math.sqrt(g.reduce((sum, each, i) => sum + (each * each) / scale[i], 0)) / radius;
    let shift = low === 0 ? 0 : low + 1e-3 * (high - low),
      solved = null,
      step = [0, 0, 0];
    for (let tried = 0; tried < 60; tried++) {
      solved = shiftedSolve(h, g, shift, scale);
      if (!solved) {
        low = shift;
        shift = low === 0 ? Math.max(0.5 * (low + high), 1e-3 * high) : 0.5 * (low + high);
        continue;
      }
      step = solved.step;
      const norm = lengthIn(scale, step);
      if (Math.abs(norm - radius) <= 0.1 * radius || (norm < radius && shift === 0)) break;
      if (norm > radius) low = shift;
      else high = shift;
      if (high - low <= 1e-10 * high) break;
      const newton = solved.slope > 0 ? shift + (((norm - radius) / radius) * norm * norm) / solved.slope : low;
      shift = low < newton && newton < high ? newton : 0.5 * (low + high);
    }
    if (!solved) step = shiftedSolve(h, g, high, scale)?.step ?? step;
    return toBoundary(h, g, high, scale, radius, generic, step);
  }

  /** The trust region's first radius and its scale: a rotation counts by the displacement that it causes. */
  function firstRegion(problem) {
    const planar = problem.line ? 0 : 1;
    const number = (target) => target.count ?? 1,
      total = (targets, of) => targets.reduce((sum, target) => sum + of(target), 0);
    const mean = (targets, of) => total(targets, (target) => number(target) * of(target)) / total(targets, number);
    const size = (target) => target.xx + planar * target.yy;
    const lever = mean(problem.moving, (target) => target.x ** 2 + target.y ** 2);
    const radius = 3 * Math.sqrt(mean(problem.fixed, size) + mean(problem.moving, size));
    return {
      radius: problem.interval ? radius / problem.interval : radius,
      scale: [1, 1, planar && lever > 0 ? lever : 1],
      generic: [1, 0.7 * planar, 0.4 * planar],
    };
  }

  /**
   * The minimum of the cost near `start`: {theta, covariance, value, gradient, hessian, converged, iterations, shares,
   * logs, path}.  A step is taken only if it lowers the cost.  Converged means that the Newton decrement, the squared
   * distance to the optimum in standard deviations, is below the tolerance.  The covariance is the inverse Hessian, null
   * without convergence.  `path` has every accepted point.
   */
  function minimise(problem, start) {
    let { radius, scale, generic } = firstRegion(problem.pairs?.[0] ?? problem);
    let theta = [...start],
      trial = [...start],
      at = null,
      path = [];
    let decrement = Infinity,
      step = [0, 0, 0],
      gainExpected = Infinity,
      norm = Infinity,
      tried = 0,
      converged = false;
    const newton = (place) => {
      const solved = shiftedSolve(place.hessian, place.gradient, 0, scale);
      return solved
        ? { step: solved.step, decrement: -dot(place.gradient, solved.step) }
        : { step: null, decrement: Infinity };
    };
    for (tried = 0; tried <= MAX_ITERATIONS; tried++) {
      const next = evaluate(problem, trial);
      const gain = at === null ? Infinity : at.value - next.value;
      let better = gain > 0;
      if (!better && gainExpected <= ROUNDING * (Math.abs(at.value) + at.shares.length)) {
        // the gain is less than the rounding of the cost: only the decrement still shows it
        const after = newton(next).decrement;
        if (decrement <= RESOLVED || !(after < 0.25 * decrement && decrement < Infinity)) {
          converged = decrement <= RESOLVED;
          break;
        }
        better = true;
      } else if (tried > 0) {
        const ratio = gainExpected > 0 ? gain / gainExpected : -1;
        if (!(ratio >= 0.25)) radius = 0.25 * Math.min(norm, radius);
        else if (ratio > 0.75 && norm > 0.8 * radius) radius *= 2;
      }
      if (better) {
        at = next;
        theta = [...trial];
        path.push(theta);
      } else if (norm === 0) break;
      if (!Number.isFinite(at.value)) break;
      const full = newton(at);
      decrement = full.decrement;
      if (decrement <= TOLERANCE) {
        converged = true;
        break;
      }
      step = full.step;
      norm = step ? lengthIn(scale, step) : Infinity;
      if (norm <= radius) gainExpected = 0.5 * decrement;
      else {
        step = trustRegionStep(at.hessian, at.gradient, scale, radius, generic);
        gainExpected = decrease(at.hessian, at.gradient, step);
        norm = lengthIn(scale, step);
      }
      trial = theta.map((each, i) => each + step[i]);
    }
    const covariance = converged ? inverse3(at.hessian) : null;
    return { ...at, theta, covariance, converged, iterations: Math.min(tried, MAX_ITERATIONS), path };
  }

  /** The problem with all standard deviations multiplied by a factor. */
  function inflated(problem, factor) {
    if (problem.pairs) return { ...problem, pairs: problem.pairs.map((pair) => inflated(pair, factor)) };
    const square = factor * factor;
    const wider = (target) => ({
      ...target,
      xx: square * target.xx,
      xy: square * target.xy,
      yy: square * target.yy,
      ...(target.doppler && {
        doppler: {
          ...target.doppler,
          variance: square * target.doppler.variance,
          inputVariance: square * target.doppler.inputVariance,
        },
      }),
    });
    return { ...problem, fixed: problem.fixed.map(wider), moving: problem.moving.map(wider) };
  }

  /** `minimise` with the standard deviations inflated by each scale in turn, each optimum starting the next. */
  function register(problem, start = [0, 0, 0], scales = [1]) {
    let theta = start,
      path = [],
      iterations = 0,
      found = null,
      last = problem;
    for (const factor of scales) {
      last = factor === 1 ? problem : inflated(problem, factor);
      found = minimise(last, theta);
      theta = found.theta;
      path = path.concat(found.path);
      iterations += found.iterations;
    }
    if (scales.length > 1 && found.value > evaluate(last, start).value) return minimise(last, start);
    return { ...found, path, iterations };
  }

  // ---- Motions and measurements --------------------------------------------------------------------------------------------

  /** T(m) = R m + t; the covariance turns along. */
  function move(target, [tx, ty, phi]) {
    const there = { ...target, ...turned({ xx: 0, xy: 0, yy: 0, ...target }, Math.cos(phi), Math.sin(phi)) };
    there.x += tx;
    there.y += ty;
    return there;
  }

  /** The motion that undoes another. */
  function inverseMotion([tx, ty, phi]) {
    const cosine = Math.cos(phi),
      sine = Math.sin(phi);
    return [-(cosine * tx + sine * ty), sine * tx - cosine * ty, -phi];
  }

  /** A target measured in polar coordinates (m, rad), its covariance to first order. */
  function fromPolar(range, azimuth, sigmaRange, sigmaAzimuth) {
    const cosine = Math.cos(azimuth),
      sine = Math.sin(azimuth);
    const radial = sigmaRange ** 2,
      across = (range * sigmaAzimuth) ** 2;
    return {
      x: range * cosine,
      y: range * sine,
      xx: radial * cosine ** 2 + across * sine ** 2,
      xy: (radial - across) * cosine * sine,
      yy: radial * sine ** 2 + across * cosine ** 2,
    };
  }

  /** Semi-axes and direction (rad) of the ellipse of `sigmas` standard deviations of {xx, xy, yy}. */
  function ellipse({ xx, xy, yy }, sigmas = 3) {
    const middle = 0.5 * (xx + yy),
      root = Math.hypot(0.5 * (xx - yy), xy);
    return {
      major: sigmas * Math.sqrt(middle + root),
      minor: sigmas * Math.sqrt(Math.max(0, middle - root)),
      angle: 0.5 * Math.atan2(2 * xy, xx - yy),
    };
  }

  // ---- Means and medians ---------------------------------------------------------------------------------------------------

  const mean = (values) => values.reduce((a, b) => a + b, 0) / values.length;

  function median(values) {
    const ordered = [...values].sort((a, b) => a - b),
      half = ordered.length >> 1;
    return ordered.length % 2 ? ordered[half] : 0.5 * (ordered[half - 1] + ordered[half]);
  }

  // ---- The chi-square distribution -------------------------------------------------------------------------------------------

  /** log Gamma(z) of z > 0: Stirling's series where the next term is below 1e-13, after the recurrence has led there. */
  function logGamma(z) {
    let below = 0;
    for (; z < 15; z++) below += Math.log(z);
    const s = 1 / (z * z);
    return (z - 0.5) * Math.log(z) - z + 0.5 * LOG_2PI + (1 / 12 - s * (1 / 360 - s * (1 / 1260 - s / 1680))) / z - below;
  }

  /** The regularised lower incomplete gamma function P(a, x): by its series, or beyond a by a continued fraction (Lentz). */
  function lowerGamma(a, x) {
    if (x <= 0) return 0;
    const front = Math.exp(a * Math.log(x) - x - logGamma(a));
    if (x < a + 1) {
      let term = 1 / a,
        sum = term;
      for (let k = a + 1; term > 1e-17 * sum; k++) sum += term *= x / k;
      return front * sum;
    }
    let b = x + 1 - a,
      c = Infinity,
      d = 1 / b,
      fraction = d;
    for (let k = 1, factor = 2; Math.abs(factor - 1) > 1e-15; k++) {
      const numerator = k * (a - k);
      b += 2;
      d = 1 / (numerator * d + b);
      c = b + numerator / c;
      factor = c * d;
      fraction *= factor;
    }
    return 1 - front * fraction;
  }

  /** What a share of all draws from chi-square with n degrees of freedom stays below: by bisection, to the last bit. */
  function chiSquareQuantile(share, n) {
    const below = (x) => lowerGamma(0.5 * n, 0.5 * x) < share;
    let low = 0,
      high = n;
    while (below(high)) high *= 2;
    for (;;) {
      const middle = 0.5 * (low + high);
      if (middle === low || middle === high) return middle;
      if (below(middle)) low = middle;
      else high = middle;
    }
  }

  /** Density of chi-square with n degrees of freedom at x > 0. */
  const chiSquareDensity = (x, n) =>
    Math.exp((0.5 * n - 1) * Math.log(0.5 * x) - 0.5 * x - logGamma(0.5 * n)) / 2;

  // ---- Credibility, in any number of dimensions -----------------------------------------------------------------------------

  const LEVELS = [0.5, 0.95, 0.99];
  const TAIL = 0.025; // on either side of the region of the ANEES

  /** The factor L of a symmetric matrix L L'; null unless it is positive definite by more than rounding. */
  function cholesky(matrix) {
    const root = matrix.map(() => []);
    for (let i = 0; i < matrix.length; i++) {
      for (let j = 0; j <= i; j++) {
        let rest = matrix[i][j];
        for (let k = 0; k < j; k++) rest -= root[i][k] * root[j][k];
        if (i > j) root[i][j] = rest / root[j][j];
        else if (rest > 1e-14 * matrix[i][i]) root[i][i] = Math.sqrt(rest);
        else return null;
      }
    }
    return root;
  }

  /** L^-1 e, as d2d.whiten: independent standard normals if the covariance is true; null if it is not positive definite. */
  function whiten(error, covariance) {
    const root = cholesky(covariance);
    if (!root) return null;
    const values = [];
    for (const [i, each] of error.entries())
      values.push(values.reduce((rest, value, k) => rest - root[i][k] * value, each) / root[i][i]);
    return values;
  }

  /** e' Sigma^-1 e. */
  const nees = (error, covariance) => whiten(error, covariance).reduce((sum, value) => sum + value * value, 0);

  /** Mean square error matrix of errors (n). */
  const meanSquare = (errors) => errors[0].map((_, i) => errors[0].map((_, j) => mean(errors.map((e) => e[i] * e[j]))));

  /** Share of the errors that lie within the region of each level, from their NEES in n dimensions; as d2d.coverage. */
  function coverage(own, n, levels = LEVELS) {
    return levels.map((level) => {
      const bound = chiSquareQuantile(level, n);
      return mean(own.map((each) => (each <= bound ? 1 : 0)));
    });
  }

  /**
   * {nees, anees, bounds (95 %), consistent, credibleNees, nci, inclination} of N errors (n), N > n, and their covariances,
   * as d2d.credibility, and the `actual` mean square error matrix; null if that is singular.
   */
  function credibility(errors, covariances) {
    const actual = meanSquare(errors);
    if (!cholesky(actual)) return null;
    const freedom = errors.length * actual.length;
    const own = errors.map((error, k) => nees(error, covariances[k]));
    const credible = errors.map((error) => nees(error, actual));
    // an error of exactly zero is perfectly credible: 0 / 0 counts as 1
    const decibels = own.map((each, k) => (credible[k] > 0 ? 10 * Math.log10(each / credible[k]) : 0));
    const anees = mean(own) / actual.length;
    const bounds = [TAIL, 1 - TAIL].map((share) => chiSquareQuantile(share, freedom) / freedom);
    return {
      nees: own,
      credibleNees: credible,
      anees,
      bounds,
      consistent: bounds[0] <= anees && anees <= bounds[1],
      nci: mean(decibels.map(Math.abs)),
      inclination: mean(decibels),
      actual,
    };
  }

  // ---- Noise -----------------------------------------------------------------------------------------------------------------

  /** A generator of standard normal numbers from a seed: mulberry32, and Box & Muller. */
  function normals(seed) {
    let state = seed >>> 0,
      spare = null;
    const uniform = () => {
      state = (state + 0x6d2b79f5) >>> 0;
      let t = Math.imul(state ^ (state >>> 15), 1 | state);
      t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
      return ((t ^ (t >>> 14)) >>> 0) / 4294967296;
    };
    return () => {
      if (spare !== null) {
        const kept = spare;
        spare = null;
        return kept;
      }
      const radius = Math.sqrt(-2 * Math.log(1 - uniform())),
        angle = 2 * Math.PI * uniform();
      spare = radius * Math.sin(angle);
      return radius * Math.cos(angle);
    };
  }

  return {
    evaluate,
    surface,
    minimise,
    register,
    inflated,
    exponential,
    move,
    inverseMotion,
    fromPolar,
    ellipse,
    dopplerGradients,
    dopplerMeasurement,
    mean,
    median,
    lowerGamma,
    chiSquareQuantile,
    chiSquareDensity,
    whiten,
    nees,
    coverage,
    credibility,
    normals,
    ANNEALED: [10, 5.5, 3.2, 1.7, 1],
    source: String(engine), // a worker of a page that was opened from a folder can load no file
  };
})();
