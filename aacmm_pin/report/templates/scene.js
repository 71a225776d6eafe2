// Draws a scene with meshcat's viewer, moves it through its frames, and reads them out.
"use strict";
(() => {
  const data = JSON.parse(document.getElementById("scene-data").textContent);
  const pane = document.getElementById("pane");

  function trouble(id) {
    document.body.classList.add("trouble");
    document.getElementById(id).hidden = false;
  }

  function draws() {
    const canvas = document.createElement("canvas");
    return Boolean(canvas.getContext("webgl2") || canvas.getContext("webgl"));
  }

  if (typeof MeshCat === "undefined") return trouble("no-viewer");
  if (!draws()) return trouble("no-webgl");

  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const floats = (text) => new Float32Array(bytes(text).buffer);
  const node = (path) => viewer.scene_tree.find(["meshcat", ...path.split("/")]).object;

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
    const target = new Vector();
    points.forEach((p) => target.addScaledVector(p, 1 / points.length));
    let distance = 0;
    for (let turn = 0; turn < 12; turn++) { // the middle of what is seen, then the distance, and again
      distance = 0;
      for (const p of points) {
        const off = p.clone().sub(target);
        distance = Math.max(distance, off.dot(back) + Math.max((Math.abs(off.dot(right)) + room) / wide, (Math.abs(off.dot(up)) + room) / high));
      }
      for (const axis of [right, up]) {
        const seen = points.map((p) => {
          const off = p.clone().sub(target);
          return off.dot(axis) / (distance - off.dot(back));
        });
        target.addScaledVector(axis, (Math.max(...seen) + Math.min(...seen)) / 2 * distance);
      }
    }
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
  viewer.renderer.domElement.addEventListener("webglcontextlost", () => trouble("lost"));

  // --- frames
  const frames = data.frames;
  const moving = frames ? Object.entries(frames.moving).map(([path, text]) => {
    const numbers = floats(text);
    return { path, numbers, width: numbers.length / frames.count };
  }) : [];
  let current = 0;

  function place({ path, numbers, width }, frame) {
    const object = node(path);
    const [x, y, z, a, b, c, d, sx = 1, sy = 1, sz = 1] = numbers.subarray(frame * width, (frame + 1) * width);
    object.visible = Number.isFinite(x);
    if (!object.visible) return;
    object.position.set(x, y, z);
    object.quaternion.set(a, b, c, d);
    object.scale.set(sx, sy, sz);
  }

  function reshape({ path, frames: shapes }, frame) {
    const object = node(path);
    const mesh = object.children.find((child) => child.isMesh);
    object.visible = shapes[frame] !== null;
    if (!object.visible || !mesh) return;
    const [vertices, faces] = shapes[frame];
    const { BufferGeometry, BufferAttribute } = MeshCat.THREE;
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(floats(vertices), 3));
    geometry.setIndex(new BufferAttribute(new Uint16Array(bytes(faces).buffer), 1));
    const loose = geometry.toNonIndexed(); // edges of a hull stay sharp
    loose.computeVertexNormals();
    geometry.dispose();
    mesh.geometry.dispose();
    mesh.geometry = loose;
  }

  function show(frame) {
    if (!frames) return;
    current = ((frame % frames.count) + frames.count) % frames.count;
    moving.forEach((body) => place(body, current));
    frames.meshes.forEach((mesh) => reshape(mesh, current));
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

  // --- drawing; live, the commands come from the server, the last one being a mark that the scene is whole
  if (frames) wire();
  if (data.mode === "live") {
    const handle = viewer.handle_command.bind(viewer);
    viewer.handle_command = (command) => {
      handle(command);
      if (command.path === "/aacmm" && command.property === "whole") show(current);
    };
    viewer.connect();
    viewer.connection.addEventListener("close", () => { document.getElementById("gone").hidden = false; });
  } else {
    data.commands.forEach((command) => viewer.handle_command_bytearray(bytes(command)));
  }
  viewer.set_3d_pane_size();
  if (frames) {
    show(frames.start);
    const still = window.matchMedia("(prefers-reduced-motion: reduce)").matches || location.hash === "#still";
    if (data.mode !== "embedded" && frames.count > 1 && !still) play(true);
  }
  window.page = { viewer, show, play, frames, get current() { return current; } };
})();
