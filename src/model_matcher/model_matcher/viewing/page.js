'use strict';
// Lengths come in metres, in the frame of the first camera (x right, y down, z forward); in space they are shown in mm.
const data = JSON.parse(document.getElementById('data').textContent);
const element = (id) => document.getElementById(id);
const KINDS = [['edges', '#22b14c'], ['curves', '#2a80ff'], ['axes', '#ff8c1a']];
const COLOURS = ['#e6007e', '#7a3cff', '#00a3a3', '#b36b00', '#d40000'];
const AXES = [['x', '#e00000'], ['y', '#00a000'], ['z', '#0040ff']];
const MM = 1000;
const SIGMAS = 3;
// The half axis of the middle error, and the depth of a camera's pyramid, in distances of what is looked at.
const LARGEST_ERROR = 0.05, PYRAMID = 0.12, TRIAD = 0.08;
// Stamps from here on, seconds (a day of 2001), are since 1970.
const A_CLOCK = 1e9;
// Rings and points a ring of an ellipsoid.
const RINGS = 6, AROUND = 10;
const state = { moments: data.moments || [], models: data.models, at: 0, playing: null, drawing: null, again: false, chosen: false };

// -- geometry ---------------------------------------------------------------------------------------------------------

const apply = (matrix, p) => [0, 1, 2].map(
  (r) => matrix[r][0] * p[0] + matrix[r][1] * p[1] + matrix[r][2] * p[2] + matrix[r][3]);

/** A point of the frame that a rigid matrix leads to, in the frame that it comes from. */
function applyInverse(matrix, p) {
  const d = [0, 1, 2].map((r) => p[r] - matrix[r][3]);
  return [0, 1, 2].map((c) => matrix[0][c] * d[0] + matrix[1][c] * d[1] + matrix[2][c] * d[2]);
}

/** Pixels of a point of the first camera's frame; null behind the camera. */
function project(camera, point) {
  const p = applyInverse(camera.first_T_camera, point);
  if (p[2] <= 0) return null;
  return [0, 1].map((k) => camera.focal[k] * p[k] / p[2] + camera.middle[k]);
}

/** Triangles of ellipsoids {at, root}, root holding their axes as columns, as a mesh3d trace takes them. */
function ellipsoids(ones, factor) {
  const mesh = { x: [], y: [], z: [], i: [], j: [], k: [] };
  for (const one of ones) {
    const first = mesh.x.length;
    for (let ring = 0; ring <= RINGS; ring += 1) {
      for (let step = 0; step < AROUND; step += 1) {
        const down = Math.PI * ring / RINGS, turn = 2 * Math.PI * step / AROUND;
        const unit = [Math.sin(down) * Math.cos(turn), Math.sin(down) * Math.sin(turn), Math.cos(down)];
        const p = one.root.map((row, r) => MM * (one.at[r] + factor * (row[0] * unit[0] + row[1] * unit[1] + row[2] * unit[2])));
        mesh.x.push(p[0]); mesh.y.push(p[1]); mesh.z.push(p[2]);
        if (ring === RINGS) continue;
        const here = first + ring * AROUND + step, next = first + ring * AROUND + (step + 1) % AROUND;
        mesh.i.push(here, next); mesh.j.push(next, next + AROUND); mesh.k.push(here + AROUND, here + AROUND);
      }
    }
  }
  return mesh;
}

/** Degrees about x, y and z, in this order, of the rotation of a matrix. */
function angles(m) {
  const middle = Math.atan2(-m[2][0], Math.hypot(m[0][0], m[1][0]));
  return [Math.atan2(m[2][1], m[2][2]), middle, Math.atan2(m[1][0], m[0][0])].map((a) => a * 180 / Math.PI);
}

const median = (values) => values.sort((a, b) => a - b)[Math.floor(values.length / 2)];

/** Longest half axis of an ellipsoid of one sigma, metres. */
const reach = (root) => Math.max(...[0, 1, 2].map((c) => Math.hypot(root[0][c], root[1][c], root[2][c])));

// -- drawing ----------------------------------------------------------------------------------------------------------

/** The lines of an object, in the first camera's frame. */
function placedLines(object) {
  return (state.models[object.model] || []).map((line) => line.map((p) => apply(object.first_T_model, p)));
}

function drawImages(moment) {
  const room = element('images'), made = [];
  moment.cameras.forEach((camera, number) => {
    const lines = [];
    const add = (line, colour, kind, name) => {
      const pixels = line.map((p) => project(camera, p));
      if (pixels.some((p) => p === null)) return;
      const points = pixels.map((p) => `${p[0].toFixed(2)},${p[1].toFixed(2)}`).join(' ');
      lines.push(`<polyline class="${kind}" data-name="${escaped(name)}" stroke="${colour}" points="${points}"/>`);
    };
    if (element('features').checked) {
      moment.lines.forEach((line, k) => add(line, KINDS[moment.kinds[k]][1], 'feature', `${k}`));
    }
    if (element('models').checked) {
      moment.objects.forEach((object, k) => {
        for (const line of placedLines(object)) add(line, COLOURS[k % COLOURS.length], 'model', object.name);
      });
    }
    const [width, height] = camera.size;
    // Whole coordinates are the middles of pixels.
    made.push(`<svg viewBox="-0.5 -0.5 ${width} ${height}" data-camera="${number}"><image x="-0.5" y="-0.5" `
      + `width="${width}" height="${height}" href="${moment.images[number]}"/>${lines.join('')}</svg>`);
  });
  room.innerHTML = made.join('');
}

const escaped = (text) => text.replace(/[&<>"]/g, (c) => `&#${c.charCodeAt(0)};`);

/** Lines with gaps between them as one trace. */
function lineTrace(name, colour, lines, width, more) {
  const trace = { type: 'scatter3d', mode: 'lines', name, line: { color: colour, width }, x: [], y: [], z: [], ...more };
  for (const line of lines) {
    for (const p of line) { trace.x.push(MM * p[0]); trace.y.push(MM * p[1]); trace.z.push(MM * p[2]); }
    trace.x.push(null); trace.y.push(null); trace.z.push(null);
  }
  return trace;
}

/** How far off what is looked at lies, metres. */
function distance(moment) {
  const depths = moment.lines.map((line) => line[0][2]).concat(moment.objects.map((o) => o.first_T_model[2][3]));
  return depths.length ? median(depths) : 1;
}

/** By how much errors are enlarged, until the user says: the most of what is offered that keeps the middle one small. */
function chooseErrors(moment) {
  const roots = moment.ellipsoids.map((one) => one.root);
  if (!roots.length) roots.push(...moment.objects.filter((one) => one.root).map((one) => one.root));
  if (!roots.length) return;
  const one = SIGMAS * median(roots.map(reach)), most = LARGEST_ERROR * distance(moment);
  const offered = [...element('errors').options].map((option) => Number(option.value));
  element('errors').value = Math.max(1, ...offered.filter((factor) => factor * one <= most));
  state.chosen = true;
}

function frustum(camera, depth) {
  const m = camera.first_T_camera, [width, height] = camera.size;
  const corner = (u, v) => apply(m, [(u - camera.middle[0]) / camera.focal[0] * depth, (v - camera.middle[1]) / camera.focal[1] * depth, depth]);
  const [a, b, c, d] = [corner(-0.5, -0.5), corner(width - 0.5, -0.5), corner(width - 0.5, height - 0.5), corner(-0.5, height - 0.5)];
  const eye = apply(m, [0, 0, 0]);
  return [[a, b, c, d, a], [eye, a], [eye, b], [eye, c], [eye, d]];
}

function traces(moment) {
  const made = [], quiet = { hoverinfo: 'name' };
  const factor = SIGMAS * Number(element('errors').value);
  const far = distance(moment);
  if (element('features').checked) {
    KINDS.forEach(([name, colour], kind) => {
      const ones = moment.lines.filter((_, k) => moment.kinds[k] === kind);
      if (ones.length) made.push(lineTrace(name, colour, ones, 5, quiet));
      const errors = moment.ellipsoids.filter((one) => moment.kinds[one.of] === kind);
      if (factor && errors.length) {
        made.push({ type: 'mesh3d', name: `errors of ${name}`, color: colour, opacity: 0.35, hoverinfo: 'name', ...ellipsoids(errors, factor) });
      }
    });
  }
  if (element('models').checked) {
    moment.objects.forEach((object, k) => {
      const colour = COLOURS[k % COLOURS.length], lines = placedLines(object);
      made.push(lineTrace(object.name, colour, lines, 3, quiet));
      const at = apply(object.first_T_model, [0, 0, 0]);
      AXES.forEach(([name, axisColour], r) => {
        const tip = [0, 0, 0];
        tip[r] = TRIAD * far;
        made.push(lineTrace(`${object.name}: ${name}`, axisColour, [[at, apply(object.first_T_model, tip)]], 6, { showlegend: false, ...quiet }));
      });
      if (factor && object.root) {
        made.push({ type: 'mesh3d', name: `error of ${object.name}`, color: colour, opacity: 0.5, hoverinfo: 'name', ...ellipsoids([{ at, root: object.root }], factor) });
      }
    });
  }
  if (element('frusta').checked) {
    moment.cameras.forEach((camera, k) => made.push(lineTrace(`camera ${k}`, '#888', frustum(camera, PYRAMID * far), 2, { showlegend: false, ...quiet })));
  }
  return made;
}

const axis = (title) => ({ title: { text: title }, showspikes: false, backgroundcolor: '#f6f6f6', showbackground: true, gridcolor: '#ddd', zerolinecolor: '#ccc' });
const LAYOUT = {
  margin: { l: 0, r: 0, t: 0, b: 0 },
  uirevision: 'kept',
  legend: { x: 0, y: 1, bgcolor: 'rgba(255,255,255,0.7)' },
  scene: {
    aspectmode: 'data',
    uirevision: 'kept',
    xaxis: axis('x, mm'), yaxis: axis('y, mm'), zaxis: axis('z, mm'),
    // From behind and above the cameras; y points down.
    camera: { up: { x: 0, y: -1, z: 0 }, eye: { x: 0.85, y: -1, z: -1.8 } },
  },
};

function drawSpace(moment) {
  return Plotly.react(element('space'), traces(moment), LAYOUT, { displaylogo: false, responsive: true, modeBarButtonsToRemove: ['toImage', 'sendDataToCloud'] });
}

function drawTable(moment) {
  const row = (object) => {
    const m = object.first_T_model, s = object.sigma;
    const cells = [
      escaped(object.name),
      [0, 1, 2].map((r) => (MM * m[r][3]).toFixed(3)).join(' '),
      s ? s.slice(0, 3).map((v) => (MM * v).toFixed(3)).join(' ') : '',
      angles(m).map((v) => v.toFixed(3)).join(' '),
      s ? s.slice(3).map((v) => (v * 180 / Math.PI).toFixed(3)).join(' ') : '',
    ];
    return `<tr>${cells.map((cell) => `<td>${cell}</td>`).join('')}</tr>`;
  };
  element('objects').tBodies[0].innerHTML = moment.objects.map(row).join('');
}

/** Seconds, or, of a clock that tells the time of day, that. */
const clock = (stamp) => (stamp < A_CLOCK ? `${stamp.toFixed(3)} s` : `${new Date(MM * stamp).toISOString().slice(11, 23)} UTC`);

/** Draw the moment that the slider is at; what comes while plotly draws is drawn after it, the newest only. */
async function draw() {
  if (state.drawing) { state.again = true; return; }
  const moment = state.moments[state.at];
  if (!moment) return;
  state.drawing = true;
  element('words').textContent = moment.words;
  const number = data.moments && data.moments.length > 1 ? [`${state.at + 1} of ${data.moments.length}`] : [];
  const time = moment.stamp === null ? [] : [clock(moment.stamp)];
  element('where').textContent = [...number, ...time].join(', ');
  if (!state.chosen) chooseErrors(moment);
  drawImages(moment);
  drawTable(moment);
  try {
    await drawSpace(moment);
    // The browser shows it, and hears the user, before the next is drawn; a page that nobody sees draws nothing.
    await new Promise(requestAnimationFrame);
  } finally {
    state.drawing = false;
    document.body.dataset.step = `${state.at}`;
    document.body.dataset.stamp = `${moment.stamp}`;
  }
  if (state.again) { state.again = false; draw(); }
}

// -- what the user does, and what comes -------------------------------------------------------------------------------

function go(number) {
  state.at = Math.max(0, Math.min(state.moments.length - 1, number));
  element('slider').value = state.at;
  draw();
}

function stop() {
  clearTimeout(state.playing);
  state.playing = null;
  element('play').innerHTML = '&#9654; play';
}

/** One moment on, after the time that lay between the two. */
function playOn() {
  const next = (state.at + 1) % state.moments.length;
  const gap = state.moments[next].stamp === null ? 1 : state.moments[next].stamp - state.moments[state.at].stamp;
  state.playing = setTimeout(() => { if (!state.drawing) go(next); playOn(); }, MM * Math.max(0.02, Math.min(gap || 0.1, 1)));
}

element('title').textContent = data.title;
element('time').hidden = state.moments.length < 2;
element('slider').max = Math.max(0, state.moments.length - 1);
element('slider').oninput = () => { stop(); go(Number(element('slider').value)); };
element('play').onclick = () => {
  if (state.playing) { stop(); return; }
  element('play').innerHTML = '&#9632; stop';
  playOn();
};
document.onkeydown = (event) => {
  if (event.key === ' ' && event.target.tagName !== 'BUTTON' && !element('time').hidden) { event.preventDefault(); element('play').click(); }
};
for (const id of ['features', 'models', 'frusta', 'errors']) element(id).onchange = draw;
element('errors').addEventListener('input', () => { state.chosen = true; });

if (data.moments) {
  go(0);
} else {
  element('words').textContent = 'waiting for the first images, features or poses';
  document.body.dataset.step = '-1';
  const events = new EventSource('events');
  events.onmessage = (event) => {
    const record = JSON.parse(event.data);
    Object.assign(state.models, record.models);
    state.moments = [record];
    draw();
  };
  events.onerror = () => { element('words').textContent = 'the node that serves this page does not answer; trying again'; };
}
