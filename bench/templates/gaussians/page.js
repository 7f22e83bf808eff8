// The page around the renderer: camera, display mode, and pictures for browsers without WebGPU.

const $ = (id) => document.getElementById(id);
const facts = JSON.parse($('facts').textContent);
const canvas = $('view');

// Columns of f32, each as four planes of bytes, deflated; packed by export/viewer.rs.
async function unpacked() {
  const text = $('gaussians').textContent.trim();
  const parts = [];
  // Each part has a multiple of 4 characters, so that it is valid base64 by itself.
  for (let at = 0; at < text.length; at += 1 << 22) {
    parts.push(Uint8Array.from(atob(text.slice(at, at + (1 << 22))), (letter) => letter.charCodeAt(0)));
  }
  const stream = new Blob(parts).stream().pipeThrough(new DecompressionStream('gzip'));
  const planes = new Uint8Array(await new Response(stream).arrayBuffer());
  const n = facts.count;
  const column = (index) => {
    const bytes = new Uint8Array(n * 4);
    for (let plane = 0; plane < 4; plane++) {
      const from = (index * 4 + plane) * n;
      for (let i = 0; i < n; i++) { bytes[i * 4 + plane] = planes[from + i]; }
    }
    return new Float32Array(bytes.buffer);
  };
  // Interleaves columns to vectors of four; a number is a constant column.
  const fours = (...sources) => {
    const vectors = new Float32Array(n * 4);
    sources.forEach((source, lane) => {
      const values = typeof source === 'number' ? null : column(source[0]);
      for (let i = 0; i < n; i++) { vectors[i * 4 + lane] = values ? values[i] : source; }
    });
    return vectors;
  };
  // Grouped by Gaussian.
  const coefficients = () => {
    const each = 3 * ((facts.degree + 1) ** 2 - 1);
    const all = new Float32Array(n * each);
    for (let at = 0; at < each; at++) {
      const values = column(14 + at);
      for (let i = 0; i < n; i++) { all[i * each + at] = values[i]; }
    }
    return all;
  };
  return {
    count: n, means: fours([0], [1], [2], [3]), quaternions: fours([4], [5], [6], [7]),
    scales: fours([8], [9], [10], 1), colors: fours([11], [12], [13], 0), coefficients: coefficients(),
  };
}

// Affine maps are rows [3][4]; `after(a, b)` applies b first.
const after = (a, b) => a.map((row) => [0, 1, 2, 3].map((j) => row[0] * b[0][j] + row[1] * b[1][j] + row[2] * b[2][j] + (j === 3 ? row[3] : 0)));
const inverse = (m) => {
  const [a, b, c] = m;
  const minor = (p, q, i, j) => p[i] * q[j] - p[j] * q[i];
  const det = a[0] * minor(b, c, 1, 2) - a[1] * minor(b, c, 0, 2) + a[2] * minor(b, c, 0, 1);
  const linear = [
    [minor(b, c, 1, 2), -minor(a, c, 1, 2), minor(a, b, 1, 2)],
    [-minor(b, c, 0, 2), minor(a, c, 0, 2), -minor(a, b, 0, 2)],
    [minor(b, c, 0, 1), -minor(a, c, 0, 1), minor(a, b, 0, 1)],
  ].map((row) => row.map((value) => value / det));
  return linear.map((row) => [...row, -(row[0] * a[3] + row[1] * b[3] + row[2] * c[3])]);
};

// The camera relative to the chosen view's: its centre, and two angles, radians.
const moved = { eye: [0, 0, 0], yaw: 0, pitch: 0 };
const axes = () => {
  const [cy, sy, cp, sp] = [Math.cos(moved.yaw), Math.sin(moved.yaw), Math.cos(moved.pitch), Math.sin(moved.pitch)];
  // Right, down and forward in the view's camera space.
  return [[cy, 0, -sy], [sy * sp, cp, cy * sp], [sy * cp, -sp, cy * cp]];
};
const forwardBy = (metres) => { moved.eye = moved.eye.map((value, i) => value + axes()[2][i] * metres); };
const slideBy = (right, down) => { moved.eye = moved.eye.map((value, i) => value + axes()[0][i] * right + axes()[1][i] * down); };
// Rotates around the point that the camera looks at, at the depth stated in the page.
const turnBy = (yaw, pitch) => {
  forwardBy(facts.focus_m);
  moved.yaw += yaw;
  moved.pitch = Math.max(-1.5, Math.min(1.5, moved.pitch + pitch));
  forwardBy(-facts.focus_m);
};

const chosen = () => Number($('frame').value);
function currentRows() {
  const fromView = axes().map((axis) => [...axis, -(axis[0] * moved.eye[0] + axis[1] * moved.eye[1] + axis[2] * moved.eye[2])]);
  const rows = facts.views[chosen()];
  const unmoved = moved.yaw === 0 && moved.pitch === 0 && moved.eye.every((value) => value === 0);
  return unmoved ? rows : after(fromView, rows);
}

function say(rows) {
  const relative = after(rows, inverse(facts.photograph));
  const back = inverse(relative);
  const turned = Math.acos(Math.max(-1, Math.min(1, (relative[0][0] + relative[1][1] + relative[2][2] - 1) / 2))) * 180 / Math.PI;
  const [x, y, z] = back.map((row) => row[3]);
  $('pose').textContent = 'Camera ' + Math.hypot(x, y, z).toFixed(3) + ' m from the photograph\'s: right ' + x.toFixed(3) + ', down ' +
    y.toFixed(3) + ', forward ' + z.toFixed(3) + ' m; turned by ' + turned.toFixed(1) + '°';
}

let renderer = null, busy = false, again = false;
const look = () => ({
  shown: Number($('shown').value), background: facts.background, truncate: facts.truncate, inverseDepth: facts.inverse_depth,
  encoded: facts.encoded,
});

function view() {
  let [width, height] = facts.size;
  const { focal: [fx, fy], center: [cx, cy], bounds, eps2d, near, far, alpha_max: alphaMax, compensation, tiled, degree, encoded } = facts;
  let share = 1;
  while (!renderer.fits(Math.ceil(width * share), Math.ceil(height * share))) { share /= 2; }
  [width, height] = [Math.ceil(width * share), Math.ceil(height * share)];
  const [sx, sy] = [width / facts.size[0], height / facts.size[1]];
  const rows = currentRows();
  return {
    rows, eye: inverse(rows).map((row) => row[3]), width, height, eps2d, near, far, alphaMax, focal: [fx * sx, fy * sy],
    center: [cx * sx, cy * sy], bounds, compensation, tiled, degree, encoded,
  };
}

async function redraw() {
  say(currentRows());
  if (!renderer) {
    const shown = facts.pictures.indexOf(chosen());
    document.querySelectorAll('main img').forEach((image, at) => { image.hidden = at !== shown; });
    return;
  }
  again = busy;
  if (busy) { return; }
  busy = true;
  try {
    await renderer.draw(view());
    const image = await renderer.levels(look());
    if (canvas.width !== image.width || canvas.height !== image.height) { [canvas.width, canvas.height] = [image.width, image.height]; }
    canvas.getContext('2d').putImageData(image, 0, 0);
    // For scripts that control the page.
    document.body.dataset.drawn = String(1 + Number(document.body.dataset.drawn || 0));
  } catch (error) {
    fallBack(String(error.message || error));
  }
  busy = false;
  if (again) { redraw(); }
}

// Shows pictures that were rendered with the page if nothing can be drawn here.
function fallBack(reason) {
  renderer = null;
  Object.assign(moved, { eye: [0, 0, 0], yaw: 0, pitch: 0 });
  document.body.classList.remove('live');
  document.body.dataset.pictures = reason;
  const range = $('frame');
  const { pictures } = facts;
  $('what').textContent = reason + ': showing ' + (pictures.length === 1 ? 'the picture' : pictures.length + ' pictures') + ' rendered with the page.';
  // Only the views that have a picture.
  const nearest = () => pictures.reduce((best, at) => (Math.abs(at - chosen()) < Math.abs(best - chosen()) ? at : best));
  range.addEventListener('input', () => { range.value = nearest(); redraw(); });
  range.value = nearest();
  redraw();
}

function listen() {
  const start = { x: 0, y: 0, slides: false, on: false };
  canvas.addEventListener('pointerdown', (event) => {
    Object.assign(start, { x: event.clientX, y: event.clientY, on: true, slides: event.shiftKey || event.button === 2 });
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener('pointerup', () => { start.on = false; });
  canvas.addEventListener('contextmenu', (event) => event.preventDefault());
  canvas.addEventListener('pointermove', (event) => {
    if (!start.on) { return; }
    const scale = facts.size[0] / canvas.clientWidth;
    const [dx, dy] = [(event.clientX - start.x) * scale, (event.clientY - start.y) * scale];
    Object.assign(start, { x: event.clientX, y: event.clientY });
    if (start.slides) {
      slideBy(-dx * facts.focus_m / facts.K[0], -dy * facts.focus_m / facts.K[1]);
    } else {
      turnBy(-dx / facts.K[0], dy / facts.K[1]);
    }
    redraw();
  });
  canvas.addEventListener('wheel', (event) => {
    event.preventDefault();
    forwardBy(-Math.sign(event.deltaY) * facts.focus_m / 50);
    redraw();
  }, { passive: false });
  const step = facts.focus_m / 100;
  const keys = {
    a: () => slideBy(-step, 0), d: () => slideBy(step, 0), q: () => slideBy(0, -step), e: () => slideBy(0, step),
    w: () => forwardBy(step), s: () => forwardBy(-step),
    ArrowLeft: () => turnBy(-0.01, 0), ArrowRight: () => turnBy(0.01, 0), ArrowUp: () => turnBy(0, 0.01), ArrowDown: () => turnBy(0, -0.01),
  };
  canvas.addEventListener('keydown', (event) => {
    if (!keys[event.key] || event.ctrlKey || event.metaKey || event.altKey) { return; }
    event.preventDefault();
    keys[event.key]();
    redraw();
  });
  const back = () => { Object.assign(moved, { eye: [0, 0, 0], yaw: 0, pitch: 0 }); redraw(); };
  $('back').addEventListener('click', back);
  $('frame').addEventListener('input', back);
  $('shown').addEventListener('change', redraw);
  $('save').addEventListener('click', () => {
    const link = document.createElement('a');
    Object.assign(link, { download: 'view.png', href: canvas.toDataURL('image/png') });
    link.click();
  });
}

(async () => {
  try {
    const shaders = JSON.parse($('shaders').textContent);
    renderer = await GaussianRenderer.open(unpacked, shaders);
    if (!renderer) {
      fallBack('This browser has no WebGPU here');
      return;
    }
    renderer.device.lost.then((lost) => { if (renderer) { fallBack('The GPU was lost (' + lost.message + ')'); } });
    listen();
    await redraw();
    if (renderer) { document.body.classList.add('live'); }
  } catch (error) {
    fallBack(String(error.message || error));
  }
})();
