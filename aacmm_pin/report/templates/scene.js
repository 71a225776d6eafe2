// Draws a scene with meshcat's viewer, moves it through its frames, and reads them out.
"use strict";
(() => {
  const data = JSON.parse(document.getElementById("scene-data").textContent);
  const pane = document.getElementById("pane");

  const canvas = document.createElement("canvas");
  if (!canvas.getContext("webgl2") && !canvas.getContext("webgl")) {
    document.body.classList.add("trouble");
    document.getElementById("no-webgl").hidden = false;
    return;
  }

  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const floats = (text) => new Float32Array(bytes(text).buffer);
  const node = (path) => viewer.scene_tree.find(["meshcat", ...path.split("/")]);

  const viewer = new MeshCat.Viewer(pane);
  const FIELD = 32; // vertical field of view [degrees]: little distortion
  viewer.camera.fov = FIELD;

  // --- the camera: far enough for all points, whatever the shape of the pane; until the reader takes it over
  let taken = false;
  viewer.controls.addEventListener("start", () => { taken = true; });

  function look() {
    if (!data.view || taken) return;
    const Vector = MeshCat.THREE.Vector3;
    const turned = ([x, y, z]) => new Vector(x, z, -y); // three.js has y up
    const points = data.view.points.map(turned);
    const back = turned(data.view.direction).normalize();
    const right = new Vector(0, 1, 0).cross(back).normalize();
    const up = back.clone().cross(right);
    const high = 0.92 * Math.tan(FIELD * Math.PI / 360);
    const wide = high * viewer.camera.aspect;
    const room = data.view.room;
    const target = new Vector(); // the middle of what is seen
    for (const axis of [right, up, back]) {
      const places = points.map((p) => p.dot(axis));
      target.addScaledVector(axis, (Math.max(...places) + Math.min(...places)) / 2);
    }
    const distance = Math.max(...points.map((p) => {
      const off = p.clone().sub(target);
      return off.dot(back) + Math.max((Math.abs(off.dot(right)) + room) / wide, (Math.abs(off.dot(up)) + room) / high);
    }));
    viewer.controls.target.copy(target);
    viewer.camera.position.copy(target).addScaledVector(back, distance);
    viewer.camera.near = distance / 100;
    viewer.camera.far = distance * 20;
    viewer.camera.up.set(0, 1, 0);
    viewer.set_dirty();
  }

  viewer.set_3d_pane_size = () => {
    if (!pane.clientWidth || !pane.clientHeight) return;
    MeshCat.Viewer.prototype.set_3d_pane_size.call(viewer, pane.clientWidth, pane.clientHeight);
    look();
  };
  new ResizeObserver(() => viewer.set_3d_pane_size()).observe(pane);

  // --- frames
  const frames = data.frames;
  const moving = frames ? Object.entries(frames.moving).map(([path, text]) => [path, floats(text)]) : [];
  let current = 0;

  function place(path, rows) { // the three upper rows of a placement
    const { object } = node(path);
    object.matrix.set(...rows, 0, 0, 0, 1).decompose(object.position, object.quaternion, object.scale);
  }

  function show(frame) {
    if (!frames) return;
    current = ((frame % frames.count) + frames.count) % frames.count;
    moving.forEach(([path, rows]) => place(path, rows.subarray(12 * current, 12 * current + 12)));
    const texts = frames.readings[current];
    readings.forEach((cell, i) => { cell.textContent = texts[i]; });
    viewer.set_dirty();
    if (!slider) return;
    slider.value = String(current);
    slider.setAttribute("aria-valuetext", frames.labels.map((label, i) => `${label} ${texts[i]}`).join(", "));
    count.textContent = `${current + 1} of ${frames.count}`;
  }

  // --- the slider, and play
  const slider = document.getElementById("slider"); // none where there is one frame
  const button = document.getElementById("play");
  const count = document.getElementById("count");
  const readings = [];
  let playing = false;

  function play(on) {
    if (!slider || playing === on) return;
    playing = on;
    button.textContent = on ? "❚❚" : "▶";
    button.setAttribute("aria-label", on ? "pause" : "play");
    if (!on) return;
    let last = performance.now();
    let left = 0;
    const step = (now) => {
      if (!playing) return;
      left += (now - last) / 1000 * frames.perSecond;
      last = now;
      const whole = Math.floor(left);
      left -= whole;
      if (whole) show(current + whole);
      requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }

  function wire() {
    const list = document.getElementById("readings");
    for (const label of frames.labels) {
      list.appendChild(document.createElement("dt")).textContent = label;
      readings.push(list.appendChild(document.createElement("dd")));
    }
    if (!slider) return;
    slider.max = String(frames.count - 1);
    const stripes = frames.colours.map((colour, i) =>
      `${colour} ${100 * i / frames.count}% ${100 * (i + 1) / frames.count}%`);
    document.getElementById("stripe").style.background = `linear-gradient(to right, ${stripes.join(", ")})`;
    const by = (steps) => () => { play(false); show(current + steps); };
    slider.addEventListener("input", () => { play(false); show(Number(slider.value)); });
    button.addEventListener("click", () => play(!playing));
    document.getElementById("back").addEventListener("click", by(-1));
    document.getElementById("on").addEventListener("click", by(1));
    const keys = { " ": () => play(!playing), ArrowLeft: by(-1), ArrowRight: by(1), Home: () => { play(false); show(0); },
                   End: () => { play(false); show(frames.count - 1); } };
    document.addEventListener("keydown", (event) => {
      const own = event.target instanceof HTMLInputElement || event.target instanceof HTMLButtonElement;
      if (!keys[event.key] || event.ctrlKey || event.metaKey || event.altKey || (own && event.target !== slider)) return;
      event.preventDefault();
      keys[event.key]();
    });
  }

  // --- drawing
  if (frames) wire();
  data.commands.forEach((command) => viewer.handle_command_bytearray(bytes(command)));
  viewer.set_3d_pane_size();
  if (frames) {
    show(0);
    const still = window.matchMedia("(prefers-reduced-motion: reduce)").matches || location.hash === "#still";
    if (window === parent && frames.count > 1 && !still) play(true);
  }
  window.page = { viewer, show, play, frames, get current() { return current; } };
})();
