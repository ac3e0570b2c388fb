// The robot that turns: plain WebGL 2. A picture stays in its place where that is missing.
// Nodes move as x' = R x + p; a twist (v, w) at the point M adds f (v + w × (x - M)). Elastic bodies bend between their ends.
"use strict";
(() => {
  const VERTEX = `#version 300 es
    in vec3 point, normal;
    uniform mat3 axes, r0, r1, camera; uniform vec3 base, p0, p1, centre, scale; uniform float reach, lift;
    out vec3 facing;
    void main() {
      vec3 x = axes * point + base, a = r0 * x + p0;
      mat3 r = r0;
      if (reach > 0.0) {
        vec3 b = r1 * x + p1, along = r0 * axes[0];
        float s = clamp(point.x / reach, 0.0, 1.0), h = s * s * (3.0 - 2.0 * s);
        float stretch = dot(b - a, along);
        a = mix(a, b, h) + (s - h) * stretch * along;
        r = r0 * (1.0 - h) + r1 * h;
      }
      facing = camera * (r * (axes * normal));
      vec3 seen = camera * (a - centre) * scale;
      gl_Position = vec4(seen.xy, -seen.z - lift, 1.0);
    }`;
  const FRAGMENT = `#version 300 es
    precision highp float;
    in vec3 facing; uniform vec4 colour; uniform float lit; out vec4 shown;
    void main() {
      vec3 n = normalize(facing + vec3(0.0, 0.0, 1e-6));
      if (n.z < 0.0) n = -n;
      float light = 0.45 + 0.40 * max(dot(n, vec3(-0.30, 0.45, 0.84)), 0.0) + 0.22 * n.z;
      shown = vec4(colour.rgb * mix(1.0, light, lit) * colour.a, colour.a);
    }`;
  const bytes = (text) => {
    const plain = atob(text), out = new Uint8Array(plain.length);
    for (let k = 0; k < out.length; k++) out[k] = plain.charCodeAt(k);
    return out.buffer;
  };
  const floats = (text) => new Float32Array(bytes(text));
  const rgb = (hex) => [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16) / 255);
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const times = (m, x) => [0, 1, 2].map((i) => m[3 * i] * x[0] + m[3 * i + 1] * x[1] + m[3 * i + 2] * x[2]);
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const GROUND = { r: [1, 0, 0, 0, 1, 0, 0, 0, 1], p: [0, 0, 0] };
  const TURN = Math.atan2(0.42, 1.0), TILT = Math.atan2(0.4, Math.hypot(0.42, 1.0));

  function view(root) {
    const data = JSON.parse(root.querySelector("script").textContent);
    const canvas = root.querySelector("canvas"), one = (name) => root.querySelector(`[data-is=${name}]`);
    const gl = canvas.getContext("webgl2", { alpha: true, antialias: true });
    if (!gl) return;
    const program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source); gl.compileShader(shader); gl.attachShader(program, shader);
    }
    gl.bindAttribLocation(program, 0, "point"); gl.bindAttribLocation(program, 1, "normal");
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) return;
    gl.useProgram(program); gl.enable(gl.DEPTH_TEST); gl.clearColor(0, 0, 0, 0);
    gl.enable(gl.BLEND); gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    const uniform = {};
    for (const name of ["axes", "r0", "r1", "camera", "base", "p0", "p1", "centre", "scale", "reach", "lift", "colour", "lit"])
      uniform[name] = gl.getUniformLocation(program, name);

    const buffer = (target, values) => { gl.bindBuffer(target, gl.createBuffer()); gl.bufferData(target, values, gl.STATIC_DRAW); };
    function array(points, normals, faces) {
      const made = gl.createVertexArray();
      gl.bindVertexArray(made);
      buffer(gl.ARRAY_BUFFER, points); gl.enableVertexAttribArray(0); gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 0, 0);
      if (normals) { buffer(gl.ARRAY_BUFFER, normals); gl.enableVertexAttribArray(1); gl.vertexAttribPointer(1, 3, gl.BYTE, true, 0, 0); }
      if (faces) buffer(gl.ELEMENT_ARRAY_BUFFER, faces);
      gl.bindVertexArray(null);
      return made;
    }
    const meshes = data.meshes.map((mesh) => {
      const points = floats(mesh.points), faces = new Uint32Array(bytes(mesh.faces)), edges = floats(mesh.edges);
      const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
      for (let k = 0; k < points.length; k++) { const i = k % 3, x = points[k]; if (x < low[i]) low[i] = x; if (x > high[i]) high[i] = x; }
      return { solid: array(points, new Int8Array(bytes(mesh.normals)), faces), count: faces.length,
        lines: array(edges), ends: edges.length / 3, low, high };
    });
    const arrow = [], profile = [[0, 0.02], [0.76, 0.02], [0.76, 0.065], [1, 0]];  // turned about x
    for (let k = 0; k < 12; k++) for (let m = 0; m < 3; m++) {
      const [[x, q], [y, s]] = [profile[m], profile[m + 1]], [[c, d], [e, f]] = [k, k + 1].map((n) => [Math.cos(n * Math.PI / 6), Math.sin(n * Math.PI / 6)]);
      arrow.push(x, q * c, q * d, y, s * c, s * d, y, s * e, s * f, x, q * c, q * d, y, s * e, s * f, x, q * e, q * f);
    }
    const arrows = array(new Float32Array(arrow));
    const picked = gl.createFramebuffer(), [inks, depths] = [gl.createRenderbuffer(), gl.createRenderbuffer()];
    let moves, twists, shares, nodes, elements, number, member, first;
    function take() {
      [moves, twists, shares] = [floats(data.moves), floats(data.twists), floats(data.shares)];
      [nodes, elements] = [data.nodes.length, data.elements.length];
      [number, member] = [data.nodes, data.elements].map((names) => new Map(names.map((name, k) => [name, k])));
      first = [0];
      data.poses.forEach((pose) => first.push(first[first.length - 1] + pose.cases.length));
    }
    take();

    const now = { pose: 0, chosen: 0, turn: TURN, tilt: TILT, zoom: 1, time: 0, centre: [0, 0, 0], radius: 1, fit: 1 };
    const home = (node, pose) => {
      if (!number.has(node)) return GROUND;
      const start = 12 * (pose * nodes + number.get(node));
      return { r: Array.from(moves.subarray(start, start + 9)), p: Array.from(moves.subarray(start + 9, start + 12)) };
    };
    function moved(node, factor) {
      const at = data.poses[now.pose].at, still = home(node, now.pose);
      if (!number.has(node) || !factor || !data.poses[now.pose].cases.length) return still;
      const start = 6 * ((first[now.pose] + now.chosen) * nodes + number.get(node));
      const v = Array.from(twists.subarray(start, start + 3), (c) => c * factor);
      const w = Array.from(twists.subarray(start + 3, start + 6), (c) => c * factor);
      const arm = cross(w, still.p.map((c, k) => c - at[k]));
      const columns = [0, 1, 2].map((j) => [0, 1, 2].map((i) => still.r[3 * i + j])).map((c) => cross(w, c).map((d, i) => c[i] + d));
      return { r: [0, 1, 2].flatMap((i) => columns.map((c) => c[i])), p: still.p.map((c, k) => c + v[k] + arm[k]) };
    }
    function frame() {  // a sphere about the robot as it stands and its axes, so that it keeps its size while it turns
      const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity], corners = [];
      const include = (seen) => {
        corners.push(seen);
        seen.forEach((c, i) => { low[i] = Math.min(low[i], c); high[i] = Math.max(high[i], c); });
      };
      for (const solid of data.solids) {
        const { r, p } = home(solid.nodes[0], now.pose), mesh = meshes[solid.mesh];
        for (let k = 0; k < 8; k++) {
          const x = [0, 1, 2].map((i) => (k >> i & 1 ? mesh.high : mesh.low)[i]);
          include(times(r, times(solid.axes, x).map((c, i) => c + solid.base[i])).map((c, i) => c + p[i]));
        }
      }
      for (let k = 0; k < 3; k++) include(data.poses[now.pose].at.map((c, i) => c + (i === k ? 0.2 * data.reach : 0)));
      now.centre = low.map((c, i) => (c + high[i]) / 2);
      now.radius = Math.max(...corners.map((x) => Math.hypot(...x.map((c, i) => c - now.centre[i]))));
      const { turn, tilt, zoom } = now;
      Object.assign(now, { turn: TURN, tilt: TILT, zoom: 1, fit: 1 });
      const { camera, scale } = projection();
      const seen = corners.flatMap((x) => { const y = times(camera, x.map((c, i) => c - now.centre[i])); return [Math.abs(y[0]) * scale[0], Math.abs(y[1]) * scale[1]]; });
      Object.assign(now, { turn, tilt, zoom, fit: Math.min(1.4, Math.max(1, 0.88 / Math.max(...seen))) });
    }
    function projection() {
      const wide = canvas.clientWidth, high = canvas.clientHeight, size = now.zoom * now.fit / now.radius;
      const [ca, sa, cp, sp] = [Math.cos(now.turn), Math.sin(now.turn), Math.cos(now.tilt), Math.sin(now.tilt)];
      const away = [cp * sa, -cp * ca, sp], right = [ca, sa, 0], up = cross(away, right);
      return { camera: [right, up, away].flatMap((axis) => times(data.upright, axis)),
        scale: [size * Math.min(1, high / wide), size * Math.min(1, wide / high), 0.2 / now.radius] };
    }
    const current = () => data.poses[now.pose].cases[now.chosen];
    const slider = one("slider"), move = one("move"), colour = one("colour"), before = one("before");
    const amount = () => (current() ? slider.value / 100 * current().factor : 0);
    const share = (name) => shares[(first[now.pose] + now.chosen) * elements + member.get(name)];
    const most = () => Math.max(...data.elements.map(share), 0);
    const shades = data.shades.map(rgb);
    const coloured = () => colour.checked && current() && current().coloured;
    function paint(solid, top) {
      if (!coloured()) return rgb(solid.colour);
      if (!member.has(solid.element)) return rgb(data.no_share);
      const place = (top > 0 ? Math.max(share(solid.element), 0) / top : 0) * (shades.length - 1), k = Math.min(Math.floor(place), shades.length - 2);
      return shades[k].map((c, i) => c + (place - k) * (shades[k + 1][i] - c));
    }
    function put(solid, where) {
      gl.uniformMatrix3fv(uniform.axes, true, solid.axes); gl.uniform3fv(uniform.base, solid.base);
      gl.uniform1f(uniform.reach, solid.nodes.length > 1 ? solid.length : 0);
      [where(solid.nodes[0]), where(solid.nodes[solid.nodes.length - 1])].forEach(({ r, p }, k) => {
        gl.uniformMatrix3fv(uniform["r" + k], true, r); gl.uniform3fv(uniform["p" + k], p);
      });
    }
    function pixels() {
      const ratio = Math.min(window.devicePixelRatio || 1, 2);
      return [canvas.clientWidth, canvas.clientHeight].map((c) => Math.round(c * ratio));
    }
    function draw() {
      const [wide, high] = pixels();
      if (!wide || !high) return;
      if (canvas.width !== wide || canvas.height !== high) { canvas.width = wide; canvas.height = high; }
      gl.viewport(0, 0, wide, high); gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
      const factor = amount() * (move.checked ? Math.sin(now.time) : 1);
      const { camera, scale } = projection();
      gl.uniformMatrix3fv(uniform.camera, true, camera);
      gl.uniform3fv(uniform.centre, now.centre); gl.uniform3fv(uniform.scale, scale);
      gl.vertexAttrib3f(1, 0, 0, 1);
      const kept = new Map(), where = (node) => { if (!kept.has(node)) kept.set(node, moved(node, factor)); return kept.get(node); };
      const top = coloured() ? most() : 0;
      for (const solid of data.solids) {
        const mesh = meshes[solid.mesh];
        put(solid, where);
        gl.uniform1f(uniform.lit, 1); gl.uniform1f(uniform.lift, 0); gl.uniform4f(uniform.colour, ...paint(solid, top), 1);
        gl.bindVertexArray(mesh.solid); gl.drawElements(gl.TRIANGLES, mesh.count, gl.UNSIGNED_INT, 0);
        gl.uniform1f(uniform.lit, 0); gl.uniform1f(uniform.lift, 0.0008); gl.uniform4f(uniform.colour, ...(dark.matches ? [0.62, 0.66, 0.7] : [0.12, 0.14, 0.17]), 1);
        gl.bindVertexArray(mesh.lines); gl.drawArrays(gl.LINES, 0, mesh.ends);
      }
      if (before.checked && factor) for (const solid of data.solids) {
        put(solid, (node) => home(node, now.pose));
        gl.uniform4f(uniform.colour, 0.45, 0.5, 0.56, 0.55);
        gl.bindVertexArray(meshes[solid.mesh].lines); gl.drawArrays(gl.LINES, 0, meshes[solid.mesh].ends);
      }
      const at = data.poses[now.pose].at, length = 0.14 * data.reach;
      const tip = data.solids.length ? toolAt(where) : at;
      ["#d62728", "#2ca02c", dark.matches ? "#7d9cff" : "#1f4fd6"].forEach((ink, k) => {
        const axis = [0, 1, 2].map((i) => [0, 1, 2].map((j) => (i === (k + j) % 3 ? length : 0)));  // x of the arrow is axis k
        put({ axes: axis.flat(), base: tip, nodes: ["ground"] }, () => GROUND);
        gl.uniform1f(uniform.lit, 0); gl.uniform1f(uniform.lift, 0.35); gl.uniform4f(uniform.colour, ...rgb(ink), 1);
        gl.bindVertexArray(arrows); gl.drawArrays(gl.TRIANGLES, 0, arrow.length / 3);
        const end = tip.map((c, i) => c + (i === k ? 1.2 * length : 0) - now.centre[i]), seen = times(camera, end), label = one("xyz"[k]);
        label.style.left = `${50 * (1 + seen[0] * scale[0])}%`; label.style.top = `${50 * (1 - seen[1] * scale[1])}%`;
      });
      const spear = (tip, along, node) => {  // an arrow that ends at a point, with its node
        const size = Math.hypot(...along), side = cross(along, Math.abs(along[0]) < 0.9 * size ? [1, 0, 0] : [0, 1, 0]);
        const thick = side.map((c) => 1.8 * length * c / Math.hypot(...side)), other = cross(along, thick).map((c) => c / size);
        put({ axes: [0, 1, 2].flatMap((i) => [along[i], thick[i], other[i]]), base: tip.map((c, i) => c - along[i]), nodes: [node] }, where);
        gl.bindVertexArray(arrows); gl.drawArrays(gl.TRIANGLES, 0, arrow.length / 3);
      };
      for (const mark of data.marks || []) {
        gl.uniform4f(uniform.colour, ...rgb(mark.colour), 1);
        spear(mark.at, mark.direction.map((c) => length * c), mark.node);
      }
      for (const [k, heads] of [[0, 1], [3, 2]]) {  // the load: a force with one head, a moment with two
        const load = current() && current().load ? current().load.slice(k, k + 3) : [0, 0, 0], size = Math.hypot(...load);
        if (!size) continue;
        const along = load.map((c) => 1.6 * length * c / size);
        gl.uniform4f(uniform.colour, ...rgb("#e07b00"), 1);
        for (let head = 0; head < heads; head++) spear(tip.map((c, i) => c - 0.2 * head * along[i]), along, "ground");
      }
      gl.bindVertexArray(null);
    }
    function pick(x, y) {  // the solid at a point of the canvas: each is drawn once in a colour that numbers it
      const [wide, high] = [canvas.width, canvas.height], { camera, scale } = projection(), ink = new Uint8Array(4), factor = amount();
      gl.bindFramebuffer(gl.FRAMEBUFFER, picked);
      for (const [buffer, format, place] of [[inks, gl.RGBA8, gl.COLOR_ATTACHMENT0], [depths, gl.DEPTH_COMPONENT16, gl.DEPTH_ATTACHMENT]]) {
        gl.bindRenderbuffer(gl.RENDERBUFFER, buffer); gl.renderbufferStorage(gl.RENDERBUFFER, format, wide, high);
        gl.framebufferRenderbuffer(gl.FRAMEBUFFER, place, gl.RENDERBUFFER, buffer);
      }
      const at = [Math.floor(x * wide / canvas.clientWidth), Math.floor(high - 1 - y * high / canvas.clientHeight)];
      gl.viewport(0, 0, wide, high); gl.enable(gl.SCISSOR_TEST); gl.scissor(...at, 1, 1); gl.disable(gl.BLEND);
      gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
      gl.uniformMatrix3fv(uniform.camera, true, camera); gl.uniform3fv(uniform.centre, now.centre); gl.uniform3fv(uniform.scale, scale);
      gl.uniform1f(uniform.lit, 0); gl.uniform1f(uniform.lift, 0);
      data.solids.forEach((solid, k) => {
        put(solid, (node) => moved(node, factor));
        gl.uniform4f(uniform.colour, ((k + 1) & 255) / 255, ((k + 1) >> 8) / 255, 0, 1);
        gl.bindVertexArray(meshes[solid.mesh].solid); gl.drawElements(gl.TRIANGLES, meshes[solid.mesh].count, gl.UNSIGNED_INT, 0);
      });
      gl.readPixels(...at, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, ink);
      gl.bindVertexArray(null); gl.bindFramebuffer(gl.FRAMEBUFFER, null); gl.disable(gl.SCISSOR_TEST); gl.enable(gl.BLEND);
      return data.solids[ink[0] + 256 * ink[1] - 1];
    }
    const told = one("tip");
    function marked(x, y) {  // the mark whose arrow is near a point of the canvas
      const { camera, scale } = projection(), length = 0.14 * data.reach, factor = amount();
      return (data.marks || []).find((mark) => {
        const { r, p } = moved(mark.node, factor), middle = mark.at.map((c, i) => c - 0.3 * length * mark.direction[i]);
        const seen = times(camera, times(r, middle).map((c, i) => c + p[i] - now.centre[i]));
        return Math.hypot(canvas.clientWidth * (1 + seen[0] * scale[0]) / 2 - x, canvas.clientHeight * (1 - seen[1] * scale[1]) / 2 - y) < 12;
      });
    }
    function point(event) {
      const still = !event.buttons && !move.checked, mark = still && marked(event.offsetX, event.offsetY);
      const found = mark || (still && pick(event.offsetX, event.offsetY));
      told.hidden = !found;
      if (!found) return;
      const has = current() && current().coloured && member.has(found.element);
      told.textContent = mark ? mark.words : has ? `${found.element}: ${(100 * share(found.element)).toPrecision(3)} % (${data.quantity})` : found.element;
      told.style.left = `${Math.min(event.offsetX + 14, canvas.clientWidth - told.offsetWidth)}px`; told.style.top = `${event.offsetY + 14}px`;
    }
    function toolAt(where) {
      const { r, p } = where(data.tool.node), x = times(r, data.tool.at);
      return x.map((c, i) => c + p[i]);
    }
    let asked = false, last = 0;
    function ask() { if (!asked) { asked = true; requestAnimationFrame(step); } }
    function step(time) {
      asked = false;
      if (move.checked && document.visibilityState === "visible") {
        if (time - last < 30) return ask();
        now.time += Math.min(time - last, 100) * 2 * Math.PI / 1600;
        ask();
      }
      last = time;
      draw();
      root.dataset.drawn = "yes";
    }
    function options(select, labels, chosen) {
      select.replaceChildren(...labels.map((label, k) => new Option(label, k, false, k === chosen)));
    }
    function say() {
      const pose = data.poses[now.pose], shown = current();
      one("amount").textContent = shown ? `× ${+(amount()).toPrecision(3)}` : "none";
      slider.setAttribute("aria-valuetext", one("amount").textContent);
      const parts = shown && shown.coloured ? data.elements.map((name) => [name, share(name)]).sort((a, b) => b[1] - a[1]).slice(0, 5).filter((s) => s[1] > 0.005) : [];
      const energy = parts.map(([name, s]) => `${name} ${(100 * s).toFixed(0)} %`).join(", ");
      one("note").textContent = [pose.place, shown && shown.note, energy && `${data.quantity}: ${energy}`].filter(Boolean).join("; ");
      const key = one("key"), scale = coloured();
      key.replaceChildren();
      const box = (style, text) => {
        const item = document.createElement("span"), mark = document.createElement("i");
        mark.style.background = style;
        item.append(mark, text); key.append(item);
      };
      if (scale) {
        const bar = document.createElement("span"), top = 100 * most(), marks = document.createElement("span");
        bar.className = "bar"; bar.style.background = `linear-gradient(90deg, ${data.shades.join(",")})`;
        marks.className = "marks";
        for (const part of [0, 0.25, 0.5, 0.75, 1]) marks.append(Object.assign(document.createElement("span"), { textContent: `${+(part * top).toPrecision(2)}` }));
        const whole = document.createElement("span");
        whole.className = "gauge"; whole.append(bar, marks); key.append(`${data.quantity}, %`, whole);
      }
      else Object.entries(data.key).forEach(([name, ink]) => box(ink, name));
      new Map((data.marks || []).map((mark) => [mark.kind, mark.colour])).forEach((ink, kind) => box(ink, kind));
      ask();
    }
    function pose() {
      now.pose = +one("pose").value;
      const cases = data.poses[now.pose].cases;
      now.chosen = Math.min(now.chosen, Math.max(cases.length - 1, 0));
      options(one("case"), cases.map((c) => c.label), now.chosen);
      for (const control of [one("case"), slider, move, colour, before]) control.closest("label").hidden = !cases.length;
      frame(); say();
    }
    const turn = (a, b) => { now.turn += a; now.tilt = Math.max(-1.57, Math.min(1.57, now.tilt + b)); ask(); };
    const pan = (right, up) => {  // by pixels
      const { camera, scale } = projection(), far = [2 * right / canvas.clientWidth / scale[0], 2 * up / canvas.clientHeight / scale[1]];
      now.centre = now.centre.map((c, i) => c - far[0] * camera[i] + far[1] * camera[3 + i]); ask();
    };
    const zoom = (factor) => { now.zoom = Math.max(0.3, Math.min(12, now.zoom * factor)); ask(); };
    const commands = {
      left: () => turn(-0.2, 0), right: () => turn(0.2, 0), up: () => turn(0, 0.2), down: () => turn(0, -0.2),
      nearer: () => zoom(1.25), farther: () => zoom(0.8), reset: () => { frame(); Object.assign(now, { turn: TURN, tilt: TILT, zoom: 1 }); ask(); },
    };
    for (const [name, act] of Object.entries(commands)) one(name).addEventListener("click", act);
    const keys = { ArrowLeft: "left", ArrowRight: "right", ArrowUp: "up", ArrowDown: "down", "+": "nearer", "-": "farther", 0: "reset" };
    const ways = { ArrowLeft: [-30, 0], ArrowRight: [30, 0], ArrowUp: [0, -30], ArrowDown: [0, 30] };
    canvas.addEventListener("keydown", (event) => {
      if (event.shiftKey && event.key in ways) { pan(...ways[event.key]); event.preventDefault(); return; }
      if (!(event.key in keys)) return;
      commands[keys[event.key]](); event.preventDefault();
    });
    canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("pointerleave", () => { told.hidden = true; });
    canvas.addEventListener("pointerup", point);
    canvas.addEventListener("pointermove", (event) => {
      point(event);
      if (event.buttons & 2 || (event.buttons & 1 && event.shiftKey)) pan(event.movementX, event.movementY);
      else if (event.buttons & 1) turn(-event.movementX / 150, event.movementY / 150);
    });
    canvas.addEventListener("wheel", (event) => {  // a page that is scrolled past the robot keeps scrolling
      if (document.activeElement !== canvas) return;
      event.preventDefault(); zoom(Math.exp(-event.deltaY / 500));
    }, { passive: false });
    dark.addEventListener("change", ask);
    canvas.addEventListener("webglcontextlost", () => root.classList.remove("live"));
    options(one("pose"), data.poses.map((each) => each.name), 0);
    one("pose").addEventListener("change", pose);
    one("case").addEventListener("change", (event) => { now.chosen = +event.target.value; say(); });
    for (const control of [slider, colour, before]) control.addEventListener("input", say);
    move.addEventListener("change", () => { now.time = Math.PI / 2; ask(); });
    move.checked = data.moving && !matchMedia("(prefers-reduced-motion: reduce)").matches;
    root.classList.add("live");
    root.update = (fresh) => { Object.assign(data, fresh); take(); pose(); };  // other poses and cases of the same solids
    root.look = (seen) => { if (seen) Object.assign(now, seen); ask(); return { turn: now.turn, tilt: now.tilt, zoom: now.zoom, chosen: now.chosen }; };
    new ResizeObserver(() => { if (pixels().some((c, i) => c !== [canvas.width, canvas.height][i])) ask(); }).observe(canvas);
    pose();
  }
  // Graphics take a second to begin where no card helps: the page stands first, and a robot waits until it is near.
  const near = new IntersectionObserver((met) => {
    for (const { target } of met.filter((each) => each.isIntersecting)) {
      near.unobserve(target);
      requestAnimationFrame(() => setTimeout(() => view(target)));
    }
  }, { rootMargin: "60% 0px" });
  document.querySelectorAll(".robot-view").forEach((root) => near.observe(root));
  window.viewRobot = view;
})();
