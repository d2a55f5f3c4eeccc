(function () {
  "use strict";
  const data = JSON.parse(document.getElementById("recording").textContent), frames = data.frames;
  const $ = (id) => document.getElementById(id), root = document.documentElement;
  const names = Object.keys(frames[0].estimates_cm);
  const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
  /* Only what some frame has: a method that compares images has neither patches nor particles. */
  const shown = { patches: "patches", neighbours: "neighbors_cm", particles: "particles_cm", truth: "truth_cm" }, layers = {};
  for (const [name, key] of Object.entries(shown)) if (frames.some((frame) => frame[key])) layers[name] = true;
  names.forEach((name) => { layers[name] = true; });
  if (location.search === "?small") root.classList.add("small");

  let now = 0, playing = null, floorImage = null;
  const pictures = new Map(), color = (name) => getComputedStyle(root).getPropertyValue(name).trim();
  /* The colours of the figures; a method without one takes what is left. */
  const owned = { "the paper's filter": "--paper", filter: "--paper", paper: "--paper", field: "--field", fine: "--fine", "neighbours alone": "--neighbors" };
  const free = ["--paper", "--field", "--fine", "--other"].filter((each) => !names.some((name) => owned[name] === each)), variable = {};
  names.forEach((name) => { variable[name] = owned[name] || free.shift() || "--soft"; });
  const methodColor = (name) => color(variable[name]);

  function setTheme(name) { root.dataset.theme = name === "dark" ? "dark" : "light"; draw(); }

  /* A canvas as sharp as the screen; its context counts in CSS pixels. */
  function canvas(id) {
    const element = $(id), box = element.getBoundingClientRect(), ratio = devicePixelRatio || 1;
    if (!box.width) return null;
    element.width = Math.round(box.width * ratio); element.height = Math.round(box.height * ratio);
    const context = element.getContext("2d");
    context.scale(ratio, ratio);
    return { context, width: box.width, height: box.height };
  }

  function picture(i) {
    if (!pictures.has(i)) { const image = new Image(); image.onload = () => i === now && draw(); image.src = frames[i].image; pictures.set(i, image); }
    return pictures.get(i);
  }

  function drawCamera(frame) {
    if (!frame.image) { $("camera").hidden = true; document.querySelector(".none").hidden = false; return; }
    const image = picture(now);
    if (image.naturalWidth) $("camera").style.aspectRatio = `${image.naturalWidth} / ${image.naturalHeight}`;
    const c = canvas("camera");
    if (!c) return;
    if (image.complete && image.naturalWidth) c.context.drawImage(image, 0, 0, c.width, c.height);
    if (layers.patches && frame.patches) {
      c.context.strokeStyle = "rgba(255,255,255,.85)"; c.context.lineWidth = 1;
      for (const [x, y] of frame.patches) c.context.strokeRect((x / 1000) * c.width, (y / 1000) * c.height, 3, 3);
    }
  }

  function drawHistogram(frame) {
    const c = canvas("histogram"), bars = frame.histogram;
    if (!c || !bars) return;
    const most = Math.max(...bars, 1), step = c.width / bars.length;
    c.context.fillStyle = color("--soft");
    bars.forEach((value, i) => { const h = (value / most) * (c.height - 4); c.context.fillRect(i * step + 1, c.height - h, step - 2, h); });
  }

  function drawFloor(frame) {
    const c = canvas("floor");
    if (!c) return;
    const [x0, x1, y0, y1] = data.area, pad = 14;
    const scale = Math.min((c.width - 2 * pad) / (x1 - x0), (c.height - 2 * pad) / (y1 - y0));
    const left = (c.width - scale * (x1 - x0)) / 2, top = (c.height - scale * (y1 - y0)) / 2;
    const at = (cm) => [left + scale * (cm[0] / 100 - x0), top + scale * (y1 - cm[1] / 100)];
    const dot = (cm, radius, fill, stroke) => {
      if (!cm || cm[0] === null) return;
      c.context.beginPath(); c.context.arc(...at(cm), radius, 0, 7);
      if (fill) { c.context.fillStyle = fill; c.context.fill(); }
      if (stroke) { c.context.strokeStyle = stroke; c.context.lineWidth = 2; c.context.stroke(); }
    };
    if (data.floor && floorImage && floorImage.naturalWidth) {
      const [l, r, b, t] = data.floor.extent_m, [px, py] = at([100 * l, 100 * t]);
      c.context.globalAlpha = 0.45; c.context.drawImage(floorImage, px, py, scale * (r - l), scale * (t - b)); c.context.globalAlpha = 1;
    }
    c.context.strokeStyle = color("--line"); c.context.strokeRect(left, top, scale * (x1 - x0), scale * (y1 - y0));
    const trail = (get, stroke, from) => {
      c.context.beginPath(); c.context.strokeStyle = stroke; c.context.lineWidth = 1.6;
      for (let i = from; i <= now; i++) { const cm = get(frames[i]); if (cm && cm[0] !== null) c.context.lineTo(...at(cm)); }
      c.context.stroke();
    };
    if (layers.truth) trail((f) => f.truth_cm, color("--truth"), Math.max(0, now - 40));
    if (layers.particles && frame.particles_cm) {
      frame.particles_cm.forEach((cm) => dot(cm, 2, color("--particles")));
      const own = frame.estimates_cm[names[0]], [sx, sy] = frame.spread_cm;
      if (own) { c.context.beginPath(); c.context.strokeStyle = color("--particles"); c.context.lineWidth = 1.4; c.context.ellipse(...at(own), scale * sx / 100, scale * sy / 100, 0, 0, 7); c.context.stroke(); }
    }
    if (layers.neighbours && frame.neighbors_cm) frame.neighbors_cm.forEach((cm) => dot(cm, 5, null, color("--neighbors")));
    names.forEach((name) => { if (layers[name]) dot(frame.estimates_cm[name], 6, methodColor(name), color("--page")); });
    if (layers.truth) dot(frame.truth_cm, 7, null, color("--truth"));
  }

  function drawErrors() {
    const c = canvas("errors");
    if (!c) return;
    const last = frames.length - 1 || 1, all = frames.flatMap((f) => names.map((n) => f.errors_cm[n] || 0)), most = Math.max(...all, 1);
    const x = (i) => 34 + (i / last) * (c.width - 40), y = (cm) => c.height - 6 - (cm / most) * (c.height - 16);
    c.context.fillStyle = color("--soft"); c.context.font = "11px sans-serif"; c.context.fillText(String(most), 2, 14); c.context.fillText("0", 2, c.height - 4);
    names.forEach((name) => {
      if (!layers[name]) return;
      c.context.beginPath(); c.context.strokeStyle = methodColor(name); c.context.lineWidth = 1.3;
      frames.forEach((f, i) => { if (f.errors_cm[name] !== null) c.context.lineTo(x(i), y(f.errors_cm[name])); });
      c.context.stroke();
    });
    c.context.strokeStyle = color("--ink"); c.context.lineWidth = 1; c.context.beginPath(); c.context.moveTo(x(now), 0); c.context.lineTo(x(now), c.height); c.context.stroke();
  }

  function draw() {
    const frame = frames[now];
    drawCamera(frame); drawHistogram(frame); drawFloor(frame); drawErrors();
    const readout = $("readout");
    readout.textContent = `Frame ${frame.frame}, ${frame.time_s.toFixed(1)} s. Off by: `;
    names.forEach((name, i) => {
      const mark = document.createElement("i"), error = frame.errors_cm[name];
      mark.style.background = methodColor(name);
      readout.append(i ? ", " : "", mark, `${name} ${error === null ? "unknown" : error + " cm"}`);
    });
    readout.append(".");
    $("scrub").value = now; $("scrub").setAttribute("aria-valuetext", $("readout").textContent);
  }

  function go(to) { now = Math.max(0, Math.min(frames.length - 1, to)); draw(); }

  function stop() { clearTimeout(playing); playing = null; $("play").textContent = "Play"; }

  function tick() {
    if (now >= frames.length - 1) { stop(); return; }
    const gap = Math.min(2, frames[now + 1].time_s - frames[now].time_s); // nobody waits out a pause of the recording
    playing = setTimeout(() => { go(now + 1); tick(); }, Math.max(still ? 1000 : 15, (1000 * gap) / Number($("speed").value)));
  }

  function toggle() {
    if (playing !== null) { stop(); return; }
    if (now >= frames.length - 1) now = 0;
    $("play").textContent = "Pause"; tick();
  }

  if (!frames.some((frame) => frame.histogram)) document.querySelectorAll(".histogram").forEach((each) => { each.hidden = true; });
  $("scrub").max = frames.length - 1;
  $("scrub").addEventListener("input", () => { stop(); go(Number($("scrub").value)); });
  $("play").addEventListener("click", toggle);
  const point = (event) => { const box = $("errors").getBoundingClientRect(); stop(); go(Math.round(((event.clientX - box.left - 34) / (box.width - 40)) * (frames.length - 1))); };
  $("errors").addEventListener("pointerdown", point);
  $("errors").addEventListener("pointermove", (event) => event.buttons && point(event));
  document.addEventListener("keydown", (event) => {
    if (["SELECT", "BUTTON"].includes(event.target.tagName) || (event.target.type === "checkbox")) return;
    const to = { ArrowRight: now + 1, ArrowLeft: now - 1, Home: 0, End: frames.length - 1 }[event.key];
    if (event.key === " ") toggle(); else if (to !== undefined) { stop(); go(to); } else return;
    event.preventDefault();
  });
  const dots = { neighbours: "--neighbors", particles: "--particles", truth: "--truth" };
  for (const name of Object.keys(layers)) {
    const label = document.createElement("label"), box = document.createElement("input"), mark = document.createElement("i");
    box.type = "checkbox"; box.checked = true; box.addEventListener("change", () => { layers[name] = box.checked; draw(); });
    mark.style.background = `var(${variable[name] || dots[name] || "--soft"})`;
    label.append(box, mark, name); $("layers").append(label);
  }
  if (data.floor) { floorImage = new Image(); floorImage.onload = draw; floorImage.src = data.floor.image; }
  const dark = matchMedia("(prefers-color-scheme: dark)");
  addEventListener("message", (event) => { if (event.data && event.data.theme) setTheme(event.data.theme); });
  // The page around it gives it the height that it takes.
  new ResizeObserver(() => { if (parent !== window) parent.postMessage({ height: root.offsetHeight }, "*"); }).observe(root);
  addEventListener("resize", draw);
  setTheme(dark.matches ? "dark" : "light");
})();
