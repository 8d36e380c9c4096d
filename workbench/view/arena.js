// The live arena's face: draws frames on a canvas, asks the kernel for more while it plays, sends what a person does.
// The kernel counts control periods and knows nothing of screens; everything here that moves between two of them is interpolated.

const STYLE = `
.wba {
  --floor: #f4f3f0; --ink: #222; --faint: rgba(0, 0, 0, 0.07); --edge: rgba(0, 0, 0, 0.25); --line: #4a4a4a; --wash: rgba(0, 114, 178, 0.06);
  font: 13px/1.35 var(--jp-ui-font-family, system-ui, sans-serif); color: var(--jp-ui-font-color1, #222); max-width: 700px; outline: none;
  background: var(--jp-layout-color1, #fff); padding: 4px;
}
.wba.dark { --floor: #23262b; --ink: #eee; --faint: rgba(255, 255, 255, 0.09); --edge: rgba(255, 255, 255, 0.3); --line: #b5b5b5; --wash: rgba(86, 180, 233, 0.12); }
.wba:focus-within { box-shadow: 0 0 0 2px #0072B2; }
.wba canvas { display: block; width: 100%; border: 1px solid var(--jp-border-color1, #ccc); background: var(--floor); }
.wba .row { display: flex; flex-wrap: wrap; gap: 6px; align-items: center; margin: 4px 0; }
.wba button, .wba select, .wba input[type=text] {
  font: inherit; padding: 2px 8px; color: inherit; background: var(--jp-layout-color2, #eee); border: 1px solid var(--jp-border-color1, #bbb); border-radius: 2px;
}
.wba button:hover { background: var(--jp-layout-color3, #ddd); }
.wba input[type=text] { max-width: 40vw; }
.wba input[type=range] { flex: 1; min-width: 120px; }
.wba .said { min-height: 1.35em; color: var(--jp-ui-font-color2, #444); }
.wba .title { font-weight: 600; }
.wba .view { position: relative; }
.wba .stick { position: absolute; right: 10px; bottom: 10px; width: 110px; height: 110px; border: none; touch-action: none; border-radius: 50%; background: rgba(255,255,255,0.8); }
`;
const LEADER = "#D55E00", FOLLOWER = "#0072B2", LOST = "#000000";
const BUSY = "the kernel is busy; the arena goes on as soon as it answers";
const SHOWN = {
  trails: "where each robot drove in the last 30 s", tiles: "where a follower may see the robot in front, and the tile that it is in",
  sensors: "the eight infrared sensors; the longer and darker, the more they read",
};
const DASHES = [[], [8, 4], [8, 3, 2, 3], [2, 3], [12, 3, 2, 3, 2, 3]];
const SPEEDS = [0.25, 0.5, 1, 2, 5, 10, 30];

function element(parent, tag, properties = {}) {
  const made = document.createElement(tag);
  Object.assign(made, properties);
  parent.appendChild(made);
  return made;
}

function face(el) {
  el.classList.add("wba-host");
  element(el, "style", { textContent: STYLE });
  const box = element(el, "div", { className: "wba", tabIndex: 0 });
  box.dataset.lmSuppressShortcuts = "true"; // JupyterLab's own keys stay out of it
  const title = element(box, "div", { className: "title" });
  const view = element(box, "div", { className: "view" });
  const canvas = element(view, "canvas", { role: "img", ariaLabel: "the arena from above: robots, line, trails" });
  const stick = element(view, "canvas", { className: "stick", role: "img", ariaLabel: "joystick: drag to drive the leader" });
  const row = element(box, "div", { className: "row" });
  const play = element(row, "button", { textContent: "▶ play", className: "play" });
  const step = element(row, "button", { textContent: "step", className: "step", title: "one tenth of a second" });
  const speed = element(row, "select", { className: "speed", title: "simulated seconds per second", ariaLabel: "speed: simulated seconds per second" });
  for (const value of SPEEDS) element(speed, "option", { value, textContent: `× ${value}`, selected: value === 1 });
  const scrub = element(row, "input", { type: "range", min: 0, max: 0, value: 0, step: 1, className: "scrub", title: "drag to see it again; play goes on from there", ariaLabel: "time" });
  const clock = element(row, "span", { className: "clock" });
  const count = element(box, "div", { className: "count", title: "how often a follower's bounds were left" });
  const second = element(box, "div", { className: "row" });
  const shown = {};
  for (const name of ["trails", "tiles", "sensors"]) {
    const label = element(second, "label", { title: SHOWN[name] });
    shown[name] = element(label, "input", { type: "checkbox", checked: true, className: name });
    label.appendChild(document.createTextNode(` ${name}`));
  }
  const restart = element(second, "button", { textContent: "restart", className: "restart", title: "begin again; what was learned is forgotten" });
  const name = element(second, "input", { type: "text", value: "my_drive.csv", size: 16, title: "name of the file that the drive is saved in", ariaLabel: "file name of the drive", className: "name" });
  const save = element(second, "button", { textContent: "save drive", className: "save" });
  const shapes = element(box, "div", { className: "row shapes" });
  const said = element(box, "div", { className: "said", ariaLive: "polite" });
  return { shapes, box, title, canvas, stick, play, step, speed, scrub, clock, count, shown, restart, name, save, said };
}

function render({ model, el }) {
  const ui = face(el);
  const about = model.get("about");
  const index = Object.fromEntries(about.fields.map((field, k) => [field, k]));
  const width = about.fields.length, robots = about.robots;
  const state = {
    frames: [], tallied: [], cursor: 0, playing: false, asked: 0, over: !model.get("live"), drive: model.get("drivable"),
    joystick: [0, 0], keys: new Set(), painted: "", joining: false, stepping: false, wrong: false, driving: false, scrubbed: false, last: 0, drawn: 0, counted: 0, centre: null, closed: false, generation: 0, points: null, floor: null,
  };
  ui.title.textContent = model.get("title");
  for (const part of [ui.name, ui.save, ui.stick]) part.style.display = state.drive ? "" : "none";
  ui.restart.style.display = model.get("live") ? "" : "none";
  const shaped = model.get("live") && about.shapes.length > 0;
  ui.shapes.style.display = shaped ? "" : "none";
  if (state.drive) ui.said.textContent = "Click here, then drive with the arrow keys or W A S D, or drag the round stick. ";

  // --- talking to the kernel -------------------------------------------------------------------------------------------------
  function ask(periods) {
    state.asked = performance.now();
    const message = { type: "advance", periods, generation: state.generation, have: state.frames.length };
    const [turn, speed] = state.joystick;
    if (state.driving) Object.assign(message, { turn, speed }); // only the page on which somebody drives says how
    state.driving = turn !== 0 || speed !== 0;
    model.send(message);
  }
  function hear(message, buffers) {
    if (message.type === "frames") {
      state.asked = 0;
      if (ui.said.textContent === BUSY || (state.wrong && state.playing)) ui.said.textContent = ""; // what was wrong is over
      state.wrong = state.wrong && !state.playing;
      const anew = message.generation !== state.generation;
      if (message.first > (anew ? 0 : state.frames.length)) { model.send({ type: "history" }); return; } // something was missed
      if (anew) {
        state.joining = state.generation === 0 && message.live; // a new page goes on where the scene is
        state.frames = [];
        state.tallied = [];
        state.cursor = 0;
        state.centre = null;
        state.generation = message.generation;
      }
      state.over = message.over;
      const bytes = buffers[0];
      const numbers = new Float32Array(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.byteLength));
      const size = width * robots;
      for (let k = 0; k * size < numbers.length; k++) state.frames[message.first + k] = numbers.subarray(k * size, (k + 1) * size);
      ui.scrub.max = Math.max(0, state.frames.length - 1);
      if (state.joining) state.cursor = state.frames.length - 1;
      if (state.stepping) { state.stepping = false; state.cursor = state.frames.length - 1; }
    } else if (message.type === "said") {
      ui.said.textContent = message.text;
      state.wrong = Boolean(message.stop);
      state.asked = 0;
      state.stepping = false;
      if (message.stop) pause();
    }
  }
  model.on("msg:custom", hear);
  model.send({ type: "history" });

  // --- what a person does ----------------------------------------------------------------------------------------------------
  function pause() { state.playing = false; ui.play.textContent = "▶ play"; }
  function start() {
    state.joining = state.stepping = false;
    if (state.over && state.cursor >= state.frames.length - 1) state.cursor = 0;
    state.playing = true;
    ui.play.textContent = "❚❚ pause";
  }
  ui.play.onclick = () => (state.playing ? pause() : start());
  ui.step.onclick = () => {
    pause();
    if (state.asked && performance.now() - state.asked < 3000) return;
    const next = Math.floor(state.cursor) + 1;
    if (next < state.frames.length) state.cursor = next;
    else if (!state.over) { state.stepping = true; ask(1); }
  };
  ui.scrub.oninput = () => { pause(); state.joining = state.stepping = false; state.scrubbed = true; state.cursor = Number(ui.scrub.value); };
  ui.restart.onclick = () => { pause(); model.send({ type: "restart" }); };
  ui.save.onclick = () => { pause(); ui.said.textContent = "saving …"; model.send({ type: "save", name: ui.name.value }); };

  // --- shapes ----------------------------------------------------------------------------------------------------------------
  if (shaped) {
    for (const shape of about.shapes) {
      const button = element(ui.shapes, "button", { textContent: shape, className: `shape ${shape}`, title: `ask the formation for: ${shape}` });
      button.onclick = () => { state.points = null; model.send({ type: "instruct", shape }); };
    }
    const pencil = element(ui.shapes, "button", { textContent: "draw places", className: "pencil", title: "then click where each follower is to drive; the picture turns with the leader" });
    pencil.onclick = () => { pause(); state.points = []; ui.said.textContent = `Click ${robots - 1} places beside or behind the leader.`; };
  }
  function putPlace(event) { // a click on the floor, in the leader's frame
    const box = ui.canvas.getBoundingClientRect();
    const floor = state.floor(event.clientX - box.left, event.clientY - box.top);
    const [x, y, heading] = between(state.cursor)[0][0];
    const dx = floor[0] - x, dy = floor[1] - y;
    state.points.push([Math.cos(heading) * dx + Math.sin(heading) * dy, Math.cos(heading) * dy - Math.sin(heading) * dx]);
    if (state.points.length < robots - 1) { ui.said.textContent = `${robots - 1 - state.points.length} more`; return; }
    model.send({ type: "instruct", shape: "points", points: state.points });
    state.points = null;
  }

  const KEYS = {
    ArrowUp: [0, 1], w: [0, 1], ArrowDown: [0, -1], s: [0, -1], ArrowLeft: [1, 0], a: [1, 0], ArrowRight: [-1, 0], d: [-1, 0],
  };
  function held() {
    let turn = 0, speed = 0;
    for (const key of state.keys) { turn += KEYS[key][0]; speed += KEYS[key][1]; }
    state.joystick = [Math.max(-1, Math.min(1, turn)), Math.max(-1, Math.min(1, speed))];
  }
  function takeTheWheel() { // now, not where the slider stands
    state.driving = true;
    if (state.playing && !state.scrubbed) return;
    state.scrubbed = false;
    state.cursor = Math.max(0, state.frames.length - 1);
    if (!state.playing) start();
  }
  ui.box.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return; // the browser's and JupyterLab's own
    if (event.target === ui.name || event.target === ui.speed) return;
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    if (state.drive && key in KEYS && event.target !== ui.scrub) {
      state.keys.add(key);
      held();
      takeTheWheel();
      event.preventDefault();
      event.stopPropagation();
    } else if (key === " " && event.target === ui.box) {
      ui.play.click();
      event.preventDefault();
      event.stopPropagation();
    } else if (key.length === 1) {
      event.stopPropagation(); // no letter reaches the notebook, whose commands they are
    }
  });
  ui.box.addEventListener("keyup", (event) => {
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    if (state.keys.delete(key)) { state.driving = true; held(); }
  });
  ui.box.addEventListener("focusout", () => { if (state.keys.size) { state.keys.clear(); state.driving = true; held(); } }); // no key sticks
  function release() { ui.stick.onpointermove = null; state.driving = true; state.joystick = [0, 0]; }
  function drag(event) {
    if (!event.buttons) { release(); return; }
    const box = ui.stick.getBoundingClientRect();
    const x = (2 * (event.clientX - box.left)) / box.width - 1, y = (2 * (event.clientY - box.top)) / box.height - 1;
    const clip = (value) => Math.max(-1, Math.min(1, value / 0.8));
    state.joystick = [-clip(x), -clip(y)];
    takeTheWheel();
  }
  ui.stick.onpointerdown = (event) => {
    if (event.button || !event.isPrimary) return;
    ui.stick.setPointerCapture(event.pointerId);
    ui.stick.onpointermove = drag;
    ui.box.focus();
    drag(event);
  };
  ui.stick.onpointerup = ui.stick.onpointercancel = ui.stick.onlostpointercapture = release;
  ui.canvas.onpointerdown = (event) => { ui.box.focus(); if (state.points && state.frames.length) putPlace(event); };
  // keys are for the arena that the mouse is over, and for one to drive in that has just appeared; never for the notebook around it
  const typing = () => document.activeElement && (document.activeElement.isContentEditable || /^(INPUT|TEXTAREA|SELECT)$/.test(document.activeElement.tagName));
  ui.box.addEventListener("pointerenter", (event) => {
    if (event.pointerType === "mouse" && !typing() && !ui.box.contains(document.activeElement)) ui.box.focus({ preventScroll: true });
  });
  if (state.drive) setTimeout(() => { if (!typing() && !state.closed) ui.box.focus({ preventScroll: true }); }, 50);

  // --- drawing ---------------------------------------------------------------------------------------------------------------
  const xs = about.line.map((p) => p[0]), ys = about.line.map((p) => p[1]);
  const margin = about.bounds.middle;
  const world = [Math.min(...xs) - margin, Math.max(...xs) + margin, Math.min(...ys) - margin, Math.max(...ys) + margin];
  const draw = ui.canvas.getContext("2d");
  let look = {};
  function dress() { // light or dark, as the page is
    const [r, g, b] = (getComputedStyle(ui.box).backgroundColor.match(/[\d.]+/g) || [255, 255, 255]).map(Number);
    ui.box.classList.toggle("dark", 0.3 * r + 0.6 * g + 0.1 * b < 110);
    const style = getComputedStyle(ui.box);
    look = Object.fromEntries(["floor", "ink", "faint", "edge", "line", "wash"].map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
  }
  const METRE = [0.01, 0.05, 0.1, 0.5, 1, 5, 10]; // m between the lines of the floor's grid
  function paintGrid(w, h, scale) {
    const gap = METRE.find((metres) => metres * scale > 34) || 10;
    const left = state.centre[0] - w / 2 / scale, low = state.centre[1] - h / 2 / scale;
    draw.beginPath();
    for (let x = Math.ceil(left / gap) * gap; x < left + w / scale; x += gap) { const at = w / 2 + scale * (x - state.centre[0]); draw.moveTo(at, 0); draw.lineTo(at, h); }
    for (let y = Math.ceil(low / gap) * gap; y < low + h / scale; y += gap) { const at = h / 2 - scale * (y - state.centre[1]); draw.moveTo(0, at); draw.lineTo(w, at); }
    draw.strokeStyle = look.faint;
    draw.lineWidth = 1;
    draw.stroke();
    draw.fillStyle = look.ink;
    draw.globalAlpha = 0.6;
    draw.font = "11px sans-serif";
    draw.fillText(`grid ${gap >= 1 ? `${gap} m` : `${Math.round(1000 * gap)} mm`}`, 8, h - 8);
    draw.globalAlpha = 1;
  }

  function between(cursor) { // [x, y, heading] of all robots, and the frame whose readings count
    const k = Math.max(0, Math.min(Math.floor(cursor), state.frames.length - 1));
    const a = state.frames[k], b = state.frames[Math.min(k + 1, state.frames.length - 1)], part = Math.min(1, Math.max(0, cursor - k));
    const poses = [];
    for (let i = 0; i < robots; i++) {
      const o = i * width;
      const far = Math.hypot(b[o] - a[o], b[o + 1] - a[o + 1]) > 6 * about.radius; // put somewhere else: no gliding
      const f = far ? 0 : part;
      let turn = b[o + 2] - a[o + 2];
      turn = Math.atan2(Math.sin(turn), Math.cos(turn));
      poses.push([a[o] + f * (b[o] - a[o]), a[o + 1] + f * (b[o + 1] - a[o + 1]), a[o + 2] + f * turn]);
    }
    return [poses, a, k];
  }

  function paint() {
    const ratio = window.devicePixelRatio || 1;
    const w = ui.canvas.clientWidth || 690;
    const h = Math.round(Math.min(w * 0.8, (w * (world[3] - world[2])) / (world[1] - world[0])));
    if (ui.canvas.width !== Math.round(w * ratio) || ui.canvas.height !== Math.round(h * ratio)) {
      ui.canvas.width = Math.round(w * ratio);
      ui.canvas.height = Math.round(h * ratio);
      ui.canvas.style.height = `${h}px`;
    }
    draw.setTransform(ratio, 0, 0, ratio, 0, 0);
    draw.clearRect(0, 0, w, h);
    if (!look.ink || state.drawn % 30 === 0) dress();
    if (!state.frames.length) { draw.fillStyle = look.ink; draw.fillText("waiting for the kernel …", 12, 20); return; }
    const [poses, frame, k] = between(state.cursor);
    const scale = Math.min(w / (world[1] - world[0]), h / (world[3] - world[2]));
    const home = [(world[0] + world[1]) / 2, (world[2] + world[3]) / 2];
    const reach = [w / scale / 2 - about.radius * 2, h / scale / 2 - about.radius * 2];
    const middle = [0, 1].map((axis) => poses.reduce((sum, pose) => sum + pose[axis], 0) / robots);
    const outside = poses.some((pose) => Math.abs(pose[0] - home[0]) > reach[0] || Math.abs(pose[1] - home[1]) > reach[1]);
    const spread = Math.max(...poses.map((pose) => Math.max(Math.abs(pose[0] - middle[0]) / reach[0], Math.abs(pose[1] - middle[1]) / reach[1])));
    const goal = !outside ? home : spread < 1 ? middle : poses[0]; // who drives away is followed, the leader first
    state.centre = state.centre || goal.slice();
    for (const axis of [0, 1]) state.centre[axis] += 0.08 * (goal[axis] - state.centre[axis]);
    const X = (x) => w / 2 + scale * (x - state.centre[0]), Y = (y) => h / 2 - scale * (y - state.centre[1]);
    state.floor = (px, py) => [state.centre[0] + (px - w / 2) / scale, state.centre[1] - (py - h / 2) / scale];

    paintGrid(w, h, scale);
    draw.beginPath();
    about.line.forEach((p, n) => (n ? draw.lineTo(X(p[0]), Y(p[1])) : draw.moveTo(X(p[0]), Y(p[1]))));
    draw.closePath();
    draw.lineWidth = Math.max(2, scale * about.line_width);
    draw.strokeStyle = look.line;
    draw.globalAlpha = about.free ? 0.15 : 0.55;
    draw.stroke();
    draw.globalAlpha = 1;

    if (ui.shown.trails.checked) {
      const first = Math.max(0, k - 300);
      for (let i = 0; i < robots; i++) {
        draw.beginPath();
        for (let n = first; n <= k; n += 2) {
          const o = i * width, f = state.frames[n];
          if (!f) continue;
          if (n === first) draw.moveTo(X(f[o]), Y(f[o + 1])); else draw.lineTo(X(f[o]), Y(f[o + 1]));
        }
        draw.lineTo(X(poses[i][0]), Y(poses[i][1]));
        draw.lineWidth = i === 0 ? 2 : 1.3;
        draw.setLineDash(DASHES[i % DASHES.length]);
        draw.strokeStyle = i === 0 ? LEADER : FOLLOWER;
        draw.globalAlpha = 0.75;
        draw.stroke();
        draw.setLineDash([]);
        draw.globalAlpha = 1;
      }
    }
    const tiles = ui.shown.tiles.checked;
    for (let i = 1; i < robots && tiles; i++) paintBounds(poses[i], X, Y, scale);
    for (let i = 0; i < robots; i++) {
      if (ui.shown.sensors.checked) paintSensors(poses[i], frame, i, X, Y, scale);
      paintRobot(poses[i], frame, i, X, Y, scale);
    }
    for (let i = 1; i < robots && tiles; i++) paintTile(poses[i], frame, i, X, Y, scale);
    for (let i = 0; i < robots; i++) paintLabel(poses[i], i, X, Y, scale);
    if (shaped) paintPlaces(poses[0], frame, X, Y, scale);
  }

  function paintPlaces(leader, frame, X, Y, scale) { // a ring where each follower is to be, and what is being drawn
    const ring = (x, y) => { draw.beginPath(); draw.arc(X(x), Y(y), scale * about.radius * 1.25, 0, 2 * Math.PI); draw.stroke(); };
    draw.strokeStyle = look.ink;
    draw.lineWidth = 1;
    draw.setLineDash([3, 3]);
    for (let i = 1; i < robots; i++) ring(frame[i * width + index.place_x], frame[i * width + index.place_y]);
    draw.setLineDash([]);
    const [x, y, heading] = leader, c = Math.cos(heading), s = Math.sin(heading);
    for (const [ahead, left] of state.points || []) ring(x + c * ahead - s * left, y + s * ahead + c * left);
  }

  function sector(pose, X, Y, scale, near, far, right, left) { // between two distances and two bearings, seen from a robot
    const [x, y, heading] = pose;
    draw.beginPath();
    draw.arc(X(x), Y(y), scale * far, -(heading + left), -(heading + right));
    draw.arc(X(x), Y(y), scale * near, -(heading + right), -(heading + left), true);
    draw.closePath();
  }
  function paintBounds(pose, X, Y, scale) {
    const { distance, bearing } = about.bounds;
    sector(pose, X, Y, scale, distance[0], distance[1], -bearing, bearing);
    draw.fillStyle = look.wash;
    draw.fill();
    draw.lineWidth = 0.7;
    draw.strokeStyle = look.edge;
    draw.stroke();
  }
  function paintTile(pose, frame, i, X, Y, scale) {
    const tile = frame[i * width + index.state];
    if (!about.tiles || tile < 0) return;
    const columns = about.tiles.bearing.length - 1, row = Math.floor(tile / columns), column = tile % columns;
    const d = about.tiles.distance, b = about.tiles.bearing;
    sector(pose, X, Y, scale, d[row], d[row + 1], b[column], b[column + 1]);
    draw.fillStyle = "rgba(240, 193, 75, 0.5)";
    draw.fill();
    draw.strokeStyle = look.ink;
    draw.lineWidth = 1;
    draw.stroke();
  }
  function paintSensors(pose, frame, i, X, Y, scale) {
    const [x, y, heading] = pose, spread = 0.22;
    about.sensors.forEach((angle, k) => {
      const reading = frame[i * width + index.ps0 + k];
      const share = Math.min(1, Math.log(1 + Math.max(0, reading)) / Math.log(4096));
      const cx = x + about.ring * Math.cos(heading + angle), cy = y + about.ring * Math.sin(heading + angle);
      const length = about.radius * (0.35 + 1.9 * share);
      draw.beginPath();
      draw.moveTo(X(cx), Y(cy));
      draw.arc(X(cx), Y(cy), scale * length, -(heading + angle + spread), -(heading + angle - spread));
      draw.closePath();
      draw.fillStyle = `rgba(204, 60, 120, ${0.12 + 0.6 * share})`;
      draw.fill();
    });
  }
  function paintRobot(pose, frame, i, X, Y, scale) {
    const [x, y, heading] = pose;
    const away = i > 0 && frame[i * width + index.phase] !== 0;
    draw.beginPath();
    draw.arc(X(x), Y(y), scale * about.radius, 0, 2 * Math.PI);
    draw.fillStyle = i === 0 ? LEADER : FOLLOWER;
    draw.globalAlpha = away ? 0.35 : 0.9;
    draw.fill();
    draw.globalAlpha = 1;
    draw.lineWidth = away ? 2.5 : 1;
    draw.setLineDash(away ? [4, 3] : []);
    draw.strokeStyle = away ? look.ink : LOST;
    draw.stroke();
    draw.setLineDash([]);
  }
  function paintLabel(pose, i, X, Y, scale) {
    const [x, y, heading] = pose;
    draw.beginPath();
    draw.moveTo(X(x + 0.3 * about.radius * Math.cos(heading)), Y(y + 0.3 * about.radius * Math.sin(heading)));
    draw.lineTo(X(x + 0.95 * about.radius * Math.cos(heading)), Y(y + 0.95 * about.radius * Math.sin(heading)));
    draw.strokeStyle = "#fff";
    draw.lineWidth = 3;
    draw.stroke();
    draw.fillStyle = "#fff";
    draw.font = `bold ${Math.max(9, 0.75 * scale * about.radius)}px sans-serif`;
    draw.textAlign = "center";
    draw.textBaseline = "middle";
    const back = 0.35 * about.radius;
    draw.fillText(i === 0 ? "L" : String(i), X(x - back * Math.cos(heading)), Y(y - back * Math.sin(heading)));
    draw.textAlign = "start";
    draw.textBaseline = "alphabetic";
  }
  function tally() { // losses up to every frame, all followers together
    for (let k = state.tallied.length; k < state.frames.length; k++) {
      let lost = k ? state.tallied[k - 1] : 0;
      const now = state.frames[k], before = state.frames[k - 1];
      for (let i = 1; before && i < robots; i++) lost += now[i * width + index.phase] !== 0 && before[i * width + index.phase] === 0;
      state.tallied.push(lost);
    }
  }
  function paintStick() {
    const pad = ui.stick, ink = pad.getContext("2d");
    pad.width = pad.height = 110;
    ink.strokeStyle = "#555";
    ink.beginPath();
    ink.arc(55, 55, 53, 0, 2 * Math.PI);
    ink.stroke();
    ink.fillStyle = LEADER;
    ink.beginPath();
    ink.arc(55 - 38 * state.joystick[0], 55 - 38 * state.joystick[1], 15, 0, 2 * Math.PI);
    ink.fill();
    ink.fillStyle = "#333";
    ink.fillText("drive", 42, 16);
    state.painted = String(state.joystick);
  }

  // --- the clock -------------------------------------------------------------------------------------------------------------
  function tick(now) {
    if (state.closed) return;
    requestAnimationFrame(tick);
    const visible = ui.canvas.isConnected && ui.canvas.offsetParent !== null;
    const passed = Math.min(0.25, (now - (state.last || now)) / 1000);
    state.last = now;
    if (state.playing && visible && state.frames.length) {
      const pace = Number(ui.speed.value) / about.period; // periods per second
      const latest = state.frames.length - 1;
      state.cursor = Math.min(state.cursor + passed * pace, latest);
      const ahead = Math.max(2, Math.ceil(0.2 * pace));
      const late = state.asked && now - state.asked > 3000;
      if (late) ui.said.textContent = BUSY;
      if (!state.over && latest - state.cursor < ahead && (!state.asked || late)) ask(Math.min(100, Math.max(1, Math.ceil(0.1 * pace))));
      if (state.over && state.cursor >= latest) pause();
    }
    if (visible) {
      paint();
      if (state.drive && String(state.joystick) !== state.painted) paintStick();
      state.drawn++;
    }
    if (!ui.scrub.matches(":active")) ui.scrub.value = Math.floor(state.cursor);
    ui.clock.textContent = `${(state.cursor * about.period).toFixed(1)} s`;
    if (state.frames.length > state.tallied.length) tally();
    const upTo = Math.floor(state.cursor), lost = state.tallied[upTo] || 0, earlier = state.tallied[Math.max(0, upTo - 600)] || 0;
    ui.count.textContent = `leaders lost: ${lost}, ${lost - earlier} of them in the last minute`;
    if (now - state.counted >= 1000) {
      const rate = (1000 * state.drawn) / (now - state.counted);
      state.drawn = 0;
      state.counted = now;
      ui.box.dataset.framesPerSecond = rate.toFixed(1);
      ui.box.dataset.periods = String(state.frames.length);
      const newest = state.frames[state.frames.length - 1];
      if (newest) ui.box.dataset.leader = `${newest[0].toFixed(3)} ${newest[1].toFixed(3)}`;
    }
  }
  state.counted = performance.now();
  requestAnimationFrame(tick);
  return () => { state.closed = true; model.off("msg:custom", hear); };
}

export default { render };
