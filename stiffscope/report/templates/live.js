// The live view: sliders send their values, the newest alone; what comes back takes its place on the page.
"use strict";
(() => {
  const id = (name) => document.getElementById(name), state = id("state");
  const given = JSON.parse(id("given").textContent);
  const inputs = [...document.querySelectorAll("input[data-name]")].map((input) => {
    const slider = given.find((s) => s.name === input.dataset.name && s.group === input.dataset.group);
    return { input, slider, label: input.closest("label"), shown: input.closest("label").querySelector("output"), value: slider.value };
  });
  const share = (s, x) => (s.decades ? Math.log(x / s.low) / Math.log(s.high / s.low) : (x - s.low) / (s.high - s.low || 1));
  const at = (s, t) => (s.decades ? s.low * (s.high / s.low) ** t : s.low + t * (s.high - s.low));
  const words = (s, x) => `${+(x * s.scale).toPrecision(4)} ${s.unit}`.trim();
  function set(each, value) {
    each.value = value;
    const ours = words(each.slider, value), file = words(each.slider, each.slider.value);
    each.shown.textContent = value === each.slider.value || ["pose", "load"].includes(each.slider.group) ? ours : `${ours} (file ${file})`;
    each.label.classList.toggle("moved", value !== each.slider.value);
    each.input.setAttribute("aria-valuetext", each.shown.textContent);
  }
  const choices = JSON.parse(id("choices").textContent).map((choice) => {
    const select = document.querySelector(`select[data-choice="${choice.name}"]`);
    return { choice, select, label: select.closest("label"), shown: select.closest("label").querySelector("output") };
  });
  const chosen = (each) => each.choice.values[each.select.selectedIndex];
  function show(each) {
    const moved = chosen(each) !== each.choice.value;
    each.label.classList.toggle("moved", moved);
    each.shown.textContent = moved ? `(file ${each.choice.value})` : "";
  }
  function reset() {
    for (const each of choices) { each.select.selectedIndex = each.choice.values.indexOf(each.choice.value); show(each); }
    for (const each of inputs) { each.input.value = 1000 * share(each.slider, each.slider.value); set(each, each.slider.value); }
  }
  let socket, waiting = false;
  function send() {
    if (socket.readyState !== WebSocket.OPEN || waiting) return;
    waiting = true;
    requestAnimationFrame(() => {
      waiting = false;
      const of = (group) => inputs.filter((each) => each.slider.group === group).map((each) => each.value);
      const values = inputs.filter((each) => !["pose", "load"].includes(each.slider.group) && each.value !== each.slider.value);
      const numbers = values.map((each) => [each.slider.name, each.value]);
      const others = choices.filter((each) => chosen(each) !== each.choice.value).map((each) => [each.choice.name, chosen(each)]);
      socket.send(JSON.stringify({ values: Object.fromEntries([...numbers, ...others]), pose: of("pose"), load: of("load") }));
    });
  }
  const say = (text, problem) => { state.textContent = text; state.classList.toggle("problem", !!problem); };
  const put = (name, html) => { id(name).innerHTML = html; };
  const robot = () => id("solids").querySelector(".robot-view");
  let last = null, marks = [];
  const take = {
    progress: (text) => { if (text) say(document.body.dataset.answers ? `${text}; the previous robot is shown meanwhile` : text); },
    problem: (text) => { if (text) say(text, true); if (text) take.stale(true); },
    stale: (old) => id("tables").classList.toggle("stale", old),
    seconds: (seconds) => say(`computed in ${(1000 * seconds).toFixed(0)} ms`),
    tables: (html) => put("tables", html),
    view: (data) => { last = data; if (robot() && robot().update) robot().update(data); },
    solids: (html) => {
      const seen = robot() && robot().look && robot().look();
      put("solids", html);
      if (!robot()) return;
      window.viewRobot(robot());
      if (robot().look) robot().look(seen);
      if (last && robot().update) robot().update({ ...last, marks });
    },
    maps: (html) => { put("maps", html); document.querySelector(".of-maps").hidden = !html; },
    marks: (given) => { marks = given; if (robot() && robot().update) robot().update({ marks }); },
    readings: (html) => put("readings", html),
    diagnosis: (html) => put("diagnosis", html),
    kept: (text) => say(text),
    free: (name) => { id("keep").file.value = name; },
  };
  function connect() {
    socket = new WebSocket(`ws://${location.host}/socket${location.search}`);
    socket.addEventListener("open", () => { say("connected"); send(); });
    socket.addEventListener("message", (event) => {
      for (const [name, value] of Object.entries(JSON.parse(event.data))) take[name]?.(value);
      document.body.dataset.answers = 1 + +(document.body.dataset.answers || 0);
    });
    socket.addEventListener("close", () => { say("stiffscope live has stopped; restart it and open the new address", true); });
  }
  for (const each of inputs) each.input.addEventListener("input", () => { set(each, at(each.slider, each.input.value / 1000)); send(); });
  for (const each of choices) each.select.addEventListener("change", () => { show(each); send(); });
  id("reset").addEventListener("click", () => { reset(); send(); });
  id("keep").addEventListener("submit", (event) => { event.preventDefault(); socket.send(JSON.stringify({ keep: event.target.file.value })); });
  reset();
  connect();
})();
