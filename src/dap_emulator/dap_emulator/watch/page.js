'use strict';
// Shows a recorded run. The data are those of watch/page.py; nothing is fetched from anywhere.

const data = JSON.parse(document.getElementById('data').textContent);
const byId = (id) => document.getElementById(id);
const element = (name, className, text) => {
  const made = document.createElement(name);
  if (className) made.className = className;
  if (text !== undefined) made.textContent = text;
  return made;
};
const count = (number) => number.toLocaleString('en-GB');
const BITS = { bit: 1, int8: 8, int16: 16, int32: 32, int64: 64, float32: 32, float64: 64 };
const READERS = {
  int8: Int8Array, int16: Int16Array, int32: Int32Array, int64: BigInt64Array, float32: Float32Array, float64: Float64Array,
};
// REALs of a machine that computes on bit-planes come as its own patterns, in words of 64 bits.
for (const planes of [24, 32, 40, 48, 56, 64]) {
  BITS[`machine${planes}`] = planes;
  READERS[`machine${planes}`] = BigUint64Array;
}
const PICTURE = 232; // longest side of a picture, CSS pixels
const LARGEST_ELEMENT = 24; // of a small array, CSS pixels

let step = 0;
let drawing = 0; // number of the newest drawing: an older one that is still unpacking gives up
let playing = null;
const chosen = {}; // by name of an array: { bit: -1 for values, place: -1 for the one that changed last }

// Values: blobs are compressed; what was unpacked is kept.

const unpacked = new Map();

async function bytesOf(blob) {
  if (!unpacked.has(blob)) {
    const packed = Uint8Array.from(atob(data.blobs[blob]), (letter) => letter.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream('deflate'));
    unpacked.set(blob, new Response(stream).arrayBuffer());
  }
  return unpacked.get(blob);
}

async function valuesOf(blob, dtype, size) {
  const buffer = await bytesOf(blob);
  if (dtype !== 'bit') return new READERS[dtype](buffer);
  const bytes = new Uint8Array(buffer);
  return Uint8Array.from({ length: size }, (_, index) => (bytes[index >> 3] >> (index & 7)) & 1);
}

// Numbers as they are; of the machine's patterns sign, exponent of 16 and fraction. The largest stands for infinity.
function numbersOf(values, dtype) {
  if (!dtype.startsWith('machine')) return values;
  const m = BigInt(BITS[dtype] - 8);
  const largest = (1n << (m + 7n)) - 1n;
  return Float64Array.from(values, (word) => {
    const exponent = 4 * (Number((word >> m) & 127n) - 64) - Number(m);
    const size = (word & largest) === largest ? Infinity : Number(word & ((1n << m) - 1n)) * 2 ** exponent;
    return word >> (m + 7n) ? -size : size;
  });
}

function bitsOf(values, dtype, bit) {
  if (dtype === 'bit') return values;
  const wide = dtype.startsWith('machine') ? 64 : BITS[dtype];
  const Words = { 8: Uint8Array, 16: Uint16Array, 32: Uint32Array, 64: BigUint64Array }[wide];
  const words = new Words(values.buffer);
  const found = new Uint8Array(words.length);
  for (let index = 0; index < words.length; index += 1) {
    found[index] = wide === 64 ? Number((words[index] >> BigInt(bit)) & 1n) : (words[index] >>> bit) & 1;
  }
  return found;
}

// The last change of an array before or in a step; of one of its planes, or of any.
function lastChange(array, at, place) {
  for (let index = array.changes.length - 1; index >= 0; index -= 1) {
    const change = array.changes[index];
    if (change[0] <= at && (place < 0 || change[1] === place)) return change;
  }
  return null;
}

// A vector is folded down the columns of ES elements, as the machine lays it.
function gridOf(extents) {
  if (extents.length === 2) {
    return { rows: extents[0], columns: extents[1], at: (row, column) => row * extents[1] + column };
  }
  const length = extents[0];
  const rows = Math.min(data.es, length);
  return { rows, columns: Math.ceil(length / data.es), at: (row, column) => column * data.es + row };
}

const VIRIDIS = [
  [68, 1, 84], [72, 40, 120], [62, 74, 137], [49, 104, 142], [38, 130, 142],
  [31, 158, 137], [53, 183, 121], [110, 206, 88], [181, 222, 43], [253, 231, 37],
];

function colourOf(value, low, high, logical) {
  if (logical) return value ? [250, 250, 250] : [28, 34, 42];
  const number = Number(value);
  if (!(Math.abs(number) < data.largest)) return [150, 70, 70];
  const place = (high > low ? (number - low) / (high - low) : 0) * (VIRIDIS.length - 1);
  const below = Math.max(0, Math.min(VIRIDIS.length - 2, Math.floor(place)));
  return [0, 1, 2].map((k) => VIRIDIS[below][k] + (place - below) * (VIRIDIS[below + 1][k] - VIRIDIS[below][k]));
}

function draw(canvas, shown) {
  const { grid, values, low, high, logical, active } = shown;
  const scale = Math.max(1, Math.min(LARGEST_ELEMENT, Math.floor(PICTURE / Math.max(grid.rows, grid.columns))));
  const image = new ImageData(grid.columns, grid.rows);
  for (let row = 0; row < grid.rows; row += 1) {
    for (let column = 0; column < grid.columns; column += 1) {
      const index = grid.at(row, column);
      if (index >= values.length) continue;
      const colour = colourOf(values[index], low, high, logical);
      const dim = active && !active[index] ? 0.35 : 1;
      const at = 4 * (row * grid.columns + column);
      for (let k = 0; k < 3; k += 1) image.data[at + k] = dim * colour[k] + (1 - dim) * 150;
      image.data[at + 3] = 255;
    }
  }
  const small = document.createElement('canvas');
  small.width = grid.columns;
  small.height = grid.rows;
  small.getContext('2d').putImageData(image, 0, 0);
  canvas.width = grid.columns * scale;
  canvas.height = grid.rows * scale;
  const shrink = Math.min(1, PICTURE / Math.max(canvas.width, canvas.height));
  canvas.style.width = `${canvas.width * shrink}px`;
  canvas.style.height = `${canvas.height * shrink}px`;
  const context = canvas.getContext('2d');
  context.imageSmoothingEnabled = false;
  context.drawImage(small, 0, 0, canvas.width, canvas.height);
  // Where blocks of ES x ES elements meet.
  context.fillStyle = 'rgba(220, 50, 40, 0.8)';
  for (let row = data.es; row < grid.rows; row += data.es) context.fillRect(0, row * scale, canvas.width, 1);
  for (let column = data.es; column < grid.columns; column += data.es) {
    context.fillRect(column * scale, 0, 1, canvas.height);
  }
}

// What stands under the pointer.

function indexText(shown, row, column) {
  const indices = shown.extents.length === 2 ? [row + 1, column + 1] : [shown.grid.at(row, column) + 1];
  return `${shown.name}(${indices.concat(shown.serial).join(',')})`;
}

function hover(canvas, shown) {
  canvas.onmousemove = (event) => {
    const box = canvas.getBoundingClientRect();
    const column = Math.floor(((event.clientX - box.left) / box.width) * shown.grid.columns);
    const row = Math.floor(((event.clientY - box.top) / box.height) * shown.grid.rows);
    const index = shown.grid.at(row, column);
    const inside = row >= 0 && column >= 0 && row < shown.grid.rows && column < shown.grid.columns;
    if (!inside || index >= shown.values.length) return;
    const value = shown.dtype === 'bit' ? (shown.values[index] ? '.TRUE.' : '.FALSE.') : shown.values[index];
    const still = shown.active && !shown.active[index] ? '\ninactive: keeps its value' : '';
    const tip = byId('tip');
    tip.textContent = `${indexText(shown, row, column)} = ${value}${still}`;
    tip.style.left = `${Math.min(event.clientX + 14, window.innerWidth - 240)}px`;
    tip.style.top = `${event.clientY + 14}px`;
    tip.hidden = false;
  };
  canvas.onmouseleave = () => { byId('tip').hidden = true; };
}

// Serial indices, from 1, of a plane by its number.
function serialOf(array, place) {
  const found = [];
  for (let k = array.serial.length - 1; k >= 0; k -= 1) {
    found.unshift((place % array.serial[k]) + 1);
    place = Math.floor(place / array.serial[k]);
  }
  return found;
}

async function figureOf(name, array, now, active) {
  const choice = (chosen[name] = chosen[name] || { bit: -1, place: -1 });
  const change = lastChange(array, step, choice.place) || lastChange(array, step, -1);
  if (change === null) return null;
  const [changedAt, place, blob] = change;
  const grid = gridOf(array.parallel);
  const all = await valuesOf(blob, array.dtype, array.parallel.reduce((a, b) => a * b, 1));
  const logical = array.dtype === 'bit' || choice.bit >= 0;
  const values = choice.bit >= 0 ? bitsOf(all, array.dtype, choice.bit) : numbersOf(all, array.dtype);
  const shown = {
    name, grid, values, logical, active: changedAt === step ? active : null, extents: array.parallel,
    serial: serialOf(array, place), low: array.low, high: array.high, dtype: choice.bit >= 0 ? 'bit' : array.dtype,
  };
  const figure = element('figure', changedAt === step && !now.entry ? 'changed' : '');
  figure.dataset.name = name;
  figure.dataset.place = place;
  const caption = element('figcaption');
  const serial = shown.serial.length ? `(${','.repeat(array.parallel.length)}${shown.serial.join(',')})` : '';
  caption.append(element('b', '', name + serial), element('span', '', `${array.kind} ${array.parallel.join(' × ')}`));
  const canvas = element('canvas');
  draw(canvas, shown);
  hover(canvas, shown);
  const under = element('div', 'under');
  if (!logical) under.append(element('span', '', `${Number(array.low.toPrecision(5))} to ${Number(array.high.toPrecision(5))}`));
  if (array.dtype !== 'bit') under.append(bitChoice(array, choice));
  const planes = new Set(array.changes.map((each) => each[1])).size;
  if (planes > 1) under.append(placeChoice(choice, planes, place));
  figure.append(caption, canvas, under);
  return figure;
}

function bitChoice(array, choice) {
  const select = element('select');
  select.title = 'values, or one bit-plane of the word';
  for (let bit = -1; bit < BITS[array.dtype]; bit += 1) {
    const option = element('option', '', bit < 0 ? 'values' : `plane ${bit}`);
    option.value = bit;
    select.append(option);
  }
  select.value = choice.bit;
  select.onchange = () => { choice.bit = Number(select.value); show(step); };
  return select;
}

function placeChoice(choice, planes, place) {
  const box = element('label', '', 'of serial planes ');
  const range = element('input');
  Object.assign(range, { type: 'range', min: 0, max: planes, value: choice.place + 1 });
  range.title = 'leftmost: the plane that changed last';
  range.oninput = () => { choice.place = Number(range.value) - 1; show(step); };
  box.append(range, element('span', '', choice.place < 0 ? ' newest' : ` ${place + 1}`));
  return box;
}

async function maskFigure(now, array, active) {
  const shown = {
    name: 'active', grid: gridOf(array.parallel), values: active, logical: true, active: null, extents: array.parallel,
    serial: [], dtype: 'bit',
  };
  const figure = element('figure', 'mask');
  figure.dataset.name = 'active';
  const caption = element('figcaption');
  const working = active.reduce((a, b) => a + b, 0);
  caption.append(element('b', '', `activity mask of ${now.mask}`), element('span', '', `${count(working)} of ${count(active.length)} active`));
  const canvas = element('canvas');
  draw(canvas, shown);
  hover(canvas, shown);
  figure.append(caption, canvas);
  return figure;
}

// One step.

function stepAt(index) {
  const [call, line, depth, cycles, spent, planes, mask, blob, entry] = data.steps[index];
  return { call, line, depth, cycles, spent, planes, mask, blob, entry };
}

async function show(index) {
  step = Math.max(0, Math.min(data.steps.length - 1, index));
  drawing += 1;
  const mine = drawing;
  const now = stepAt(step);
  const call = data.calls[now.call];
  byId('slider').value = step;
  byId('where').textContent = `${step + 1} of ${data.steps.length}: ${now.entry ? 'enter ' : ''}${call.unit}, line ${now.line}`;
  for (const row of document.querySelectorAll('#source .here')) row.classList.remove('here');
  const row = document.querySelector(`#source .row[data-line="${now.line}"]`);
  if (row) {
    row.classList.add('here');
    const pane = byId('source');
    const top = row.offsetTop - pane.offsetTop;
    if (top < pane.scrollTop + 40 || top > pane.scrollTop + pane.clientHeight - 60) pane.scrollTop = top - pane.clientHeight / 2;
  }
  showCounters(now);
  showSpent();
  showScalars(call);
  let active = null;
  const figures = [];
  if (now.mask !== null) {
    const masked = data.arrays[call.arrays[now.mask]];
    active = await valuesOf(now.blob, 'bit', masked.parallel.reduce((a, b) => a * b, 1));
    figures.push(await maskFigure(now, masked, active));
  }
  for (const [name, number] of Object.entries(call.arrays)) {
    if (data.arrays[number].dtype === 'text') continue;
    const figure = await figureOf(name, data.arrays[number], now, name === now.mask ? active : null);
    if (figure !== null) figures.push(figure);
  }
  if (mine !== drawing) return;
  byId('arrays').replaceChildren(...figures);
  document.body.dataset.step = step;
}

function showCounters(now) {
  const rows = [
    ['cycles so far', count(now.cycles)],
    ['machine time', `${(now.cycles * data.clock).toPrecision(4)} s`],
    ['this statement', now.entry ? 'entry' : `${count(now.spent)} cycles`],
    ['bit-planes in use', `${count(now.planes)} of ${count(data.planes)}`],
    ['calls open', now.depth],
  ];
  byId('counters').replaceChildren(...rows.map(([name, value]) => {
    const row = element('div');
    row.append(element('dt', '', name), element('dd', '', value));
    return row;
  }));
}

function showSpent() {
  const canvas = byId('spent');
  const context = canvas.getContext('2d');
  const style = getComputedStyle(document.body);
  context.clearRect(0, 0, canvas.width, canvas.height);
  const columns = new Float64Array(canvas.width);
  data.steps.forEach((each, index) => {
    const at = Math.floor((index / data.steps.length) * canvas.width);
    columns[at] = Math.max(columns[at], each[8] ? 0 : each[4]);
  });
  const most = Math.log1p(columns.reduce((a, b) => Math.max(a, b), 1));
  const wide = Math.max(1, canvas.width / data.steps.length - 1);
  context.fillStyle = style.getPropertyValue('--bar');
  columns.forEach((value, at) => {
    const high = (Math.log1p(value) / most) * (canvas.height - 4);
    if (high > 0) context.fillRect(at, canvas.height - high, wide, high);
  });
  context.fillStyle = style.getPropertyValue('--accent');
  context.fillRect(Math.floor((step / data.steps.length) * canvas.width), 0, 2, canvas.height);
}

function showScalars(call) {
  const values = new Map();
  for (const [at, name, text] of call.scalars) if (at <= step) values.set(name, { at, text });
  byId('scalars').replaceChildren(...[...values].map(([name, { at, text }]) => (
    element('span', at === step ? 'changed' : '', `${name} = ${text}`)
  )));
}

// What does not change with the step.

function showSource() {
  const pane = byId('source');
  const head = element('div', 'row head');
  for (const text of ['line', 'times', 'cycles', 'share', '']) head.append(element('span', text === '' ? '' : 'number', text));
  pane.append(head);
  data.source.forEach((text, index) => {
    const number = index + 1;
    const times = data.times[number] || 0;
    const cycles = (data.lines[number] || [0, 0])[1];
    const row = element('div', 'row');
    row.dataset.line = number;
    const bar = element('span', 'bar');
    bar.style.width = `${(100 * cycles) / Math.max(1, data.cycles)}%`;
    const share = element('span');
    share.title = `${((100 * cycles) / Math.max(1, data.cycles)).toFixed(1)} % of all cycles`;
    share.append(bar);
    row.append(
      element('span', 'number', number), element('span', 'times', times ? count(times) : ''),
      element('span', 'cycles', times ? count(cycles) : ''), share, element('span', '', text),
    );
    row.onclick = () => goToLine(number);
    pane.append(row);
  });
}

// The next statement of a line, from the beginning when there is none after this one.
function goToLine(line) {
  const total = data.steps.length;
  for (let ahead = 1; ahead <= total; ahead += 1) {
    const index = (step + ahead) % total;
    if (data.steps[index][1] === line) {
      show(index);
      return;
    }
  }
}

function showOperations() {
  const rows = byId('operations');
  const most = Math.max(1, ...data.operations.map((each) => each[2]));
  for (const [name, times, cycles] of data.operations) {
    const bar = element('span', 'bar');
    bar.style.width = `${(100 * cycles) / most}%`;
    rows.append(
      element('span', '', name), element('span', 'right', `${count(times)} times`),
      element('span', 'right', `${count(cycles)} cycles, ${((100 * cycles) / Math.max(1, data.cycles)).toFixed(1)} %`), bar,
    );
  }
}

function flameTree() {
  const root = { unit: '', line: 0, total: 0, inner: new Map() };
  for (const [path, cycles] of data.profile) {
    let at = root;
    root.total += cycles;
    for (const [unit, line] of path) {
      const key = `${unit}:${line}`;
      if (!at.inner.has(key)) at.inner.set(key, { unit, line, total: 0, inner: new Map() });
      at = at.inner.get(key);
      at.total += cycles;
    }
  }
  return root;
}

function showFlame() {
  const root = flameTree();
  const pane = byId('flame');
  let deepest = 0;
  const place = (node, depth, left) => {
    let at = left;
    for (const inner of [...node.inner.values()].sort((a, b) => a.line - b.line)) {
      const width = (100 * inner.total) / Math.max(1, root.total);
      if (width >= 0.08) {
        deepest = Math.max(deepest, depth);
        const box = element('div', 'box', `${inner.unit}:${inner.line} ${(data.source[inner.line - 1] || '').trim()}`);
        box.style.cssText = `left:${at}%;width:${width}%;top:${20 * depth}px;background:hsl(${20 + ((inner.line * 47) % 40)} 85% ${62 + ((inner.line * 13) % 16)}%)`;
        box.title = `${inner.unit}, line ${inner.line}: ${count(inner.total)} cycles, ${width.toFixed(1)} %\n${(data.source[inner.line - 1] || '').trim()}`;
        box.onclick = () => goToLine(inner.line);
        pane.append(box);
        place(inner, depth + 1, at);
      }
      at += width;
    }
  };
  place(root, 0, 0);
  pane.style.height = `${20 * (deepest + 1) + 2}px`;
}

function play() {
  if (playing !== null) {
    clearInterval(playing);
    playing = null;
  } else {
    if (step === data.steps.length - 1) step = -1;
    playing = setInterval(() => {
      if (step >= data.steps.length - 1) play();
      else show(step + 1);
    }, 180);
  }
  byId('play').textContent = playing === null ? '▶ play' : '⏸ pause';
}

byId('title').textContent = data.title;
byId('machine').textContent = `${data.model}, ${data.es} × ${data.es} PEs: ${count(data.cycles)} cycles, ${data.seconds.toPrecision(5)} s, computed, not simulated; at most ${count(data.peak)} of ${count(data.planes)} bit-planes`;
byId('note').textContent = data.note;
byId('printed').textContent = data.printed.join('\n');
byId('slider').max = data.steps.length - 1;
byId('slider').oninput = () => show(Number(byId('slider').value));
byId('first').onclick = () => show(0);
byId('back').onclick = () => show(step - 1);
byId('next').onclick = () => show(step + 1);
byId('last').onclick = () => show(data.steps.length - 1);
byId('play').onclick = play;
byId('spent').onclick = (event) => {
  const box = byId('spent').getBoundingClientRect();
  show(Math.floor(((event.clientX - box.left) / box.width) * data.steps.length));
};
document.onkeydown = (event) => {
  const keys = { ArrowLeft: () => show(step - 1), ArrowRight: () => show(step + 1), Home: () => show(0), End: () => show(data.steps.length - 1), ' ': play };
  if (event.target.tagName === 'SELECT' || event.target.type === 'range' && event.target.id !== 'slider' || !keys[event.key]) return;
  event.preventDefault();
  keys[event.key]();
};
showSource();
showOperations();
showFlame();
show(Number(window.location.hash.slice(1)) - 1 || 0); // page.html#12 begins at the twelfth step
