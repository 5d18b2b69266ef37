// Active Bayesian perception of where and what in plain JavaScript, after Lepora, Martinez-Hernandez and Prescott,
// "A SOLID case for active Bayesian perception in robot touch", 2013. Answers the conformance cases of this folder:
//
//     node solid.js < case.jsonl
//
// Letters are the paper's: L where classes, M what classes, K taxels, J samples of a tap, B bins; indices count from 0.
// A belief is a list of L rows of M logarithmic weights, which are known up to a common constant: `total` is the
// logarithm of their sum. So a class may be as improbable as it likes and still comes back.

'use strict';

const BORDERS = ['uniform', 'uniform_what', 'prior', 'clamp', 'circular'];

class BadInput extends Error {}

const range = (n) => Array.from({ length: n }, (_, i) => i);
const sum = (values) => values.reduce((a, b) => a + b, 0);
const largest = (values) => values.reduce((best, value, i) => (value > values[best] ? i : best), 0);
const each = (rows, change) => rows.map((row, l) => row.map((value, m) => change(value, l, m)));

function logSum(logs) {
  const top = logs.reduce((a, b) => Math.max(a, b), -Infinity);
  return top === -Infinity ? top : top + Math.log(sum(logs.map((x) => Math.exp(x - top))));
}

// What a line must hold: the value of a key, whole numbers, and lists of finite numbers of a given shape.

function get(object, key) {
  if (object?.[key] === undefined) throw new BadInput(`the key "${key}" is missing.`);
  return object[key];
}

function whole(object, key, low, high) {
  const value = get(object, key);
  if (!Number.isInteger(value) || value < low || value > high) {
    throw new BadInput(`the key "${key}" must be a whole number from ${low} to ${high}.`);
  }
  return value;
}

function numbers(object, key, shape, low = -Infinity) {
  const fits = (value, axis) =>
    axis === shape.length
      ? Number.isFinite(value) && value >= low
      : Array.isArray(value) && value.length === shape[axis] && value.every((part) => fits(part, axis + 1));
  if (fits(get(object, key), 0)) return object[key];
  const kind = low === 0 ? 'numbers that are not negative' : 'finite numbers';
  throw new BadInput(`the key "${key}" must hold ${shape.length ? shape.join(' x ') : 'one of'} ${kind}.`);
}

// Text below Eq. 2. Only inner edges are looked at, so that samples outside go to the end bins.
function bin(sample, edges) {
  let [low, high] = [0, edges.length - 2];
  while (low < high) {
    const middle = Math.ceil((low + high) / 2);
    if (sample >= edges[middle]) low = middle;
    else high = middle - 1;
  }
  return low;
}

// Eq. 2, logarithms.
function logProbabilities(histogram, pseudocount) {
  const total = sum(histogram.map((h) => h + pseudocount));
  if (!(total > 0)) throw new BadInput('a histogram in "counts" is empty while "pseudocount" is 0.');
  return histogram.map((h) => Math.log(h + pseudocount) - Math.log(total));
}

// Eq. 7 and 8: the class if its marginal is greater than the threshold, else null.
const decide = (marginal, best, threshold) => (threshold < 1 && marginal[best] > threshold ? best : null);

class Perception {
  constructor(header) {
    if (get(header, 'format') !== 1) throw new BadInput('the key "format" must be 1.');
    [this.L, this.M, this.K, this.J, this.B] = [...'LMKJB'].map((size) => whole(header, size, 1, 1e6));
    const { L, M, K, J, B } = this;
    if ((header.saturation ?? null) !== null) throw new BadInput('the key "saturation" must be null: it is not done here.');
    this.name = header.case;
    this.tap = 0;
    this.fitted = null;
    this.over = false;

    const given = ['counts', 'probabilities', 'training'].filter((key) => key in header);
    if (given.length !== 1) throw new BadInput('exactly one of counts, probabilities and training must be there.');
    if (given[0] === 'training') this.fitted = this.train(get(header, 'training'));
    else this.edges = this.readEdges(header);
    if (given[0] === 'probabilities') {
      this.logTable = each(numbers(header, 'probabilities', [L, M, K, B], 0), (rows) => each(rows, Math.log));
    } else {
      const pseudocount = numbers(header, 'pseudocount', [], 0);
      const counts = this.fitted ? this.fitted.counts : numbers(header, 'counts', [L, M, K, B], 0);
      this.logTable = each(counts, (rows) => rows.map((histogram) => logProbabilities(histogram, pseudocount)));
    }

    // Classes whose probabilities are all 0 were never trained; [M][L].
    const possible = (histogram) => histogram.some((p) => p > -Infinity);
    this.trained = range(M).map((m) => this.logTable.map((place) => place[m].some(possible)));

    const prior = numbers(header, 'prior', [L, M], 0);
    if (!(Math.abs(sum(prior.flat()) - 1) < 1e-6)) throw new BadInput('the sum of "prior" must be 1.');
    this.logPrior = each(prior, Math.log);
    this.weights = this.logPrior;
    this.total = 0;

    const power = get(header, 'power');
    this.exponent = { J: 1 / J, JK: 1 / (J * K), none: 1 }[power] ?? power;
    if (!(Number.isFinite(this.exponent) && this.exponent > 0)) throw new BadInput(`the key "power" is unknown.`);
    this.border = get(header, 'border');
    if (!BORDERS.includes(this.border)) throw new BadInput(`the key "border" must be one of ${BORDERS.join(', ')}.`);
    this.thresholds = numbers(header, 'thresholds', [get(header, 'thresholds')?.length]);
    this.thetaX = numbers(header, 'theta_x', []);
    this.fixation = whole(header, 'fixation', 0, L - 1);
  }

  readEdges(header) {
    const list = get(header, 'edges');
    const own = Array.isArray(list) && Array.isArray(list[0]);
    const edges = numbers(header, 'edges', own ? [this.K, this.B + 1] : [this.B + 1]);
    const rows = own ? edges : range(this.K).map(() => edges);
    if (rows.some((row) => row.some((edge, b) => b > 0 && !(row[b - 1] < edge)))) {
      throw new BadInput('the key "edges" must hold increasing numbers.');
    }
    return rows;
  }

  // Bins of equal width over one range for all taxels, and what falls into them.
  train(training) {
    const { L, M, K, J, B } = this;
    const N = get(training, 'where')?.length;
    const taps = numbers(training, 'taps', [N, J, K]);
    const [where, what] = [numbers(training, 'where', [N]), numbers(training, 'what', [N])];
    const ranges = range(K).map((k) => {
      const samples = taps.flatMap((tap) => tap.map((row) => row[k]));
      return samples.reduce(([a, b], x) => [Math.min(a, x), Math.max(b, x)], [Infinity, -Infinity]);
    });
    const [low, high] = [Math.min(...ranges.map(([a]) => a)), Math.max(...ranges.map(([, b]) => b))];
    if (!(low < high)) throw new BadInput('the samples in "training" are all equal and have no range.');
    const cut = ([a, b]) => range(B + 1).map((i) => (i === B ? b : a + ((b - a) * i) / B));
    this.edges = ranges.map(() => cut([low, high]));
    const counts = range(L).map(() => range(M).map(() => range(K).map(() => new Array(B).fill(0))));
    taps.forEach((tap, n) => {
      if (!counts[where[n]]?.[what[n]]) throw new BadInput(`training tap ${n} has no class of this case.`);
      const histograms = counts[where[n]][what[n]];
      tap.forEach((row) => row.forEach((sample, k) => (histograms[k][bin(sample, this.edges[k])] += 1)));
    });
    return { case: this.name, tap: 0, edges: this.edges[0], counts };
  }

  // Eq. 1
  logLikelihood(samples) {
    const cells = samples.flatMap((row) => row.map((sample, k) => [k, bin(sample, this.edges[k])]));
    return each(this.logTable, (table) => {
      const logProduct = cells.reduce((total, [k, b]) => total + table[k][b], 0);
      return this.exponent * logProduct;
    });
  }

  // Eq. 3 and 4; returns the log evidence of the tap. The largest weight is brought back to 1.
  update(logLikelihood) {
    const joint = each(this.weights, (weight, l, m) => weight + logLikelihood[l][m]);
    const [before, top] = [this.total, joint.flat().reduce((a, b) => Math.max(a, b))];
    if (top === -Infinity) return top;
    this.weights = each(joint, (weight) => weight - top);
    this.total = logSum(this.weights.flat());
    return top + this.total - before;
  }

  // Where belief about each place of an object comes to lie after a move by d; -1 where it is lost, and untrained places.
  landing(trained, d) {
    const { L, border } = this;
    const near = (place) => {
      const away = trained.map((known, p) => (known ? Math.abs(p - place) : Infinity));
      return away.indexOf(Math.min(...away));
    };
    const to = trained.map((known, p) => {
      let place = p + d;
      if (border === 'circular') place = ((place % L) + L) % L;
      if (border === 'clamp') place = near(Math.min(Math.max(place, 0), L - 1));
      return known && trained[place] ? place : -1;
    });
    if (border === 'circular') {
      const free = range(L).filter((p) => trained[p] && !to.includes(p));
      return to.map((place, p) => (trained[p] && place < 0 ? free.shift() : place));
    }
    return to;
  }

  // Eq. 9: what becomes of the belief about place p is found where p + d lies.
  shift(d) {
    if (d === 0) return;
    const { L, M, border, trained } = this;
    const old = each(this.weights, (weight) => weight - this.total);
    const landing = trained.map((known) => this.landing(known, d));
    const lost = range(M).map((m) => logSum(range(L).filter((p) => landing[m][p] < 0).map((p) => old[p][m])));
    const isVacated = (p, m) => trained[m][p] && !landing[m].includes(p);
    const room = range(M).map((m) => range(L).filter((p) => isVacated(p, m)).length);
    const fill = {
      uniform: () => logSum(lost) - Math.log(sum(room)),
      uniform_what: (m) => lost[m] - Math.log(room[m]),
      prior: () => -Math.log(trained.flat().filter((known) => known).length),
      clamp: () => -Infinity,
      circular: () => -Infinity,
    }[border];
    this.weights = each(this.weights, (_, p, m) => {
      if (isVacated(p, m)) return fill(m);
      return logSum(range(L).filter((from) => landing[m][from] === p).map((from) => old[from][m]));
    });
    this.total = logSum(this.weights.flat());
  }

  // A line with a tap; the answer to it, or null after an impossible one.
  perceive(line) {
    const tap = whole(line, 'tap', 1, 1e9);
    const move = whole(line, 'move', -1e9, 1e9);
    const samples = numbers(line, 'samples', [this.J, this.K]);
    if (tap !== this.tap + 1) throw new BadInput(`tap ${tap} follows tap ${this.tap}.`);
    this.tap = tap;
    if (this.over) return null;
    this.shift(move);
    const logLikelihood = this.logLikelihood(samples);
    const logEvidence = this.update(logLikelihood);
    const read = this.readOff();
    if (logEvidence === -Infinity) {
      this.over = true;
      return { case: this.name, tap, error: 'zero_evidence' };
    }
    const logPosterior = each(this.weights, (weight) => weight - this.total);
    return {
      case: this.name,
      tap,
      log_likelihood: logLikelihood,
      log_evidence: logEvidence,
      posterior: each(logPosterior, Math.exp),
      ...read,
      log_posterior: logPosterior,
    };
  }

  // Marginals, decisions and the move, Eq. 5 to 8 and 10.
  readOff() {
    const belief = each(this.weights, (weight) => Math.exp(weight - this.total));
    const where = belief.map(sum);
    const what = range(this.M).map((m) => sum(belief.map((row) => row[m])));
    const bestWhere = largest(where);
    const bestWhat = largest(what);
    const place = decide(where, bestWhere, this.thetaX);
    const decisions = this.thresholds.map((threshold) => decide(what, bestWhat, threshold));
    return { where, what, decisions, move: place === null ? 0 : this.fixation - place };
  }
}

// JSON writes -Infinity as null, and every other number so that it is read back as the same double.
const write = (answer) => process.stdout.write(`${JSON.stringify(answer)}\n`);

// Lines end at line feeds only; those of readline would end at U+2028 inside strings too.
async function* linesOf(stream) {
  let parts = [];
  for await (const chunk of stream.setEncoding('utf8')) {
    const [end, ...more] = chunk.split('\n');
    parts.push(end);
    for (const beginning of more) {
      yield parts.join('');
      parts = [beginning];
    }
  }
  yield parts.join('');
}

async function main() {
  let [number, perception, name] = [0, null, null];
  try {
    for await (const text of linesOf(process.stdin)) {
      number += 1;
      if (text.trim() === '') continue;
      let line = null;
      try {
        line = JSON.parse(text);
      } catch {
        throw new BadInput('this is not JSON.');
      }
      if (Object.prototype.toString.call(line) !== '[object Object]') throw new BadInput('this is not a JSON object.');
      if ('tap' in line) {
        if (!perception) throw new BadInput('a tap comes before the header of its case.');
        const answer = perception.perceive(line);
        if (answer) write(answer);
      } else {
        name = get(line, 'case');
        perception = new Perception(line);
        if (perception.fitted) write(perception.fitted);
      }
    }
  } catch (error) {
    if (!(error instanceof BadInput)) throw error;
    console.error(`solid: line ${number}, case ${JSON.stringify(name)}: ${error.message}`);
    process.exitCode = 2;
    process.stdin.destroy();
  }
}

main();
