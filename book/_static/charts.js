/* Charts that tell their values on hover, tap and arrow keys, and enlarge; tables that sliders explore. No library. */
(function () {
  "use strict";
  const SVG = "http://www.w3.org/2000/svg";

  function make(name, properties, parent) {
    const element = document.createElement(name);
    Object.assign(element, properties);
    if (parent) parent.append(element);
    return element;
  }

  /* A value with four digits; the name of the tick where the axis has names. */
  function said(axis, value) {
    if (axis.names && Number(value.toPrecision(6)) in axis.names) return axis.names[Number(value.toPrecision(6))];
    return String(Number(value.toPrecision(4)));
  }

  function place(axis, low, high, value) {
    const scale = axis.log ? Math.log10 : (v) => v;
    const [first, last] = axis.limits.map(scale);
    return low + ((scale(value) - first) / (last - first)) * (high - low);
  }

  /* Every point of a chart in the coordinates of its drawing. */
  function points(data) {
    const found = [];
    for (const axes of data) {
      const [left, top, right, bottom] = axes.box;
      axes.lines.forEach((line, series) => line.x.forEach((x, i) => {
        const y = line.y[i];
        if (x === null || y === null) return;
        const px = place(axes.x, left, right, x), py = place(axes.y, bottom, top, y);
        if (px < left - 1 || px > right + 1 || py < top - 1 || py > bottom + 1) return;
        found.push({ axes, line, series, i, x, y, px, py });
      }));
    }
    return found;
  }

  function tellValues(figure, svg, data) {
    const all = points(data);
    if (!all.length) return;
    const tell = make("div", { className: "tell", hidden: true }, figure);
    tell.setAttribute("role", "status");
    const ring = document.createElementNS(SVG, "circle");
    for (const [key, value] of Object.entries({ r: 5, fill: "none", stroke: "currentColor", "stroke-width": 1.6, visibility: "hidden" }))
      ring.setAttribute(key, value);
    svg.append(ring);
    let current = -1;

    function show(index) {
      current = index;
      if (index < 0) { tell.hidden = true; ring.setAttribute("visibility", "hidden"); return; }
      const p = all[index], box = svg.getBoundingClientRect(), frame = figure.getBoundingClientRect();
      const scale = box.width / svg.viewBox.baseVal.width;
      ring.setAttribute("cx", p.px); ring.setAttribute("cy", p.py); ring.setAttribute("visibility", "visible");
      tell.textContent = [p.line.label, `${p.axes.x.label || "x"}: ${said(p.axes.x, p.x)}`, `${p.axes.y.label || "y"}: ${said(p.axes.y, p.y)}`]
        .filter(Boolean).join(" · ");
      tell.hidden = false;
      const x = box.left - frame.left + figure.scrollLeft + p.px * scale, y = box.top - frame.top + p.py * scale;
      tell.style.left = Math.max(0, Math.min(x + 10, figure.scrollLeft + frame.width - tell.offsetWidth - 4)) + "px";
      tell.style.top = Math.max(0, y - tell.offsetHeight - 8) + "px";
    }

    svg.addEventListener("pointermove", (event) => {
      const box = svg.getBoundingClientRect(), scale = svg.viewBox.baseVal.width / box.width;
      const x = (event.clientX - box.left) * scale, y = (event.clientY - box.top) * scale;
      let best = -1, least = 30 * 30;
      all.forEach((p, i) => { const d = (p.px - x) ** 2 + (p.py - y) ** 2; if (d < least) { least = d; best = i; } });
      show(best);
    });
    svg.addEventListener("pointerleave", () => show(-1));
    figure.tabIndex = 0;
    figure.setAttribute("role", "group");
    figure.setAttribute("aria-label", "Chart: arrow keys tell its values");
    figure.addEventListener("keydown", (event) => {
      if (event.target !== figure) return;
      const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
      if (step) show((current + step + all.length) % all.length);
      else if (event.key === "ArrowDown" || event.key === "ArrowUp") {
        const from = all[Math.max(0, current)], way = event.key === "ArrowDown" ? 1 : -1;
        let i = Math.max(0, current);
        do i = (i + way + all.length) % all.length; while (i !== current && all[i].line === from.line && all[i].axes === from.axes && i !== 0);
        show(i);
      } else if (event.key === "Escape") show(-1);
      else return;
      event.preventDefault();
    });
  }

  /* The same drawing over the whole window: wheel, pinch or keys enlarge it, dragging moves it. */
  function enlarge(figure, svg) {
    const dialog = make("dialog", { className: "enlarged" }, document.body);
    dialog.setAttribute("aria-label", svg.getAttribute("aria-label") || "Figure");
    const bar = make("div", {}, dialog), copy = svg.cloneNode(true);
    const [x0, y0, w0, h0] = svg.getAttribute("viewBox").split(/\s+/).map(Number);
    let view = [x0, y0, w0, h0];
    const set = () => copy.setAttribute("viewBox", view.join(" "));
    const zoom = (factor, cx = view[0] + view[2] / 2, cy = view[1] + view[3] / 2) => {
      factor = Math.min(Math.max(factor, view[2] / w0), 40 * view[2] / w0);
      view = [cx - (cx - view[0]) / factor, cy - (cy - view[1]) / factor, view[2] / factor, view[3] / factor]; set();
    };
    const whole = () => { view = [x0, y0, w0, h0]; set(); };
    for (const [word, action] of [["Closer", () => zoom(1.5)], ["Farther", () => zoom(1 / 1.5)], ["Whole", whole], ["Close", () => dialog.close()]])
      make("button", { type: "button", textContent: word, onclick: action }, bar);
    copy.removeAttribute("width"); copy.removeAttribute("height"); dialog.append(copy);
    const at = (event) => { const m = copy.getScreenCTM().inverse(); return new DOMPoint(event.clientX, event.clientY).matrixTransform(m); };
    copy.addEventListener("wheel", (event) => { event.preventDefault(); const p = at(event); zoom(event.deltaY < 0 ? 1.2 : 1 / 1.2, p.x, p.y); }, { passive: false });
    copy.addEventListener("pointermove", (event) => {
      if (!event.buttons) return;
      const scale = view[2] / copy.getBoundingClientRect().width;
      view[0] -= event.movementX * scale; view[1] -= event.movementY * scale; set();
    });
    dialog.addEventListener("keydown", (event) => { const does = { "+": () => zoom(1.5), "-": () => zoom(1 / 1.5), 0: whole }[event.key]; if (does) does(); });
    dialog.addEventListener("close", () => dialog.remove());
    dialog.showModal();
  }

  /* Sliders over a table: its first columns (data-explore says how many) are what is chosen, the row is the answer. */
  function explore(table) {
    const count = Number(table.dataset.explore), body = [...table.tBodies[0].rows];
    const rows = body.map((row) => [...row.cells].map((cell) => cell.textContent.trim()));
    const heads = [...table.tHead.rows[0].cells].map((cell) => cell.textContent.trim());
    const box = make("div", { className: "explore" });
    (table.closest(".pst-scrollable-table-container") || table).before(box);
    const start = Math.max(0, body.findIndex((row) => row.dataset.start !== undefined));
    const inputs = heads.slice(0, count).map((head, column) => {
      const values = [...new Set(rows.map((row) => row[column]))];
      const label = make("label", {}, box);
      make("span", { textContent: head }, label);
      const input = make("input", { type: "range", min: 0, max: values.length - 1, step: 1, value: values.indexOf(rows[start][column]) }, label);
      input.disabled = values.length < 2;
      return { input, values, shown: make("output", {}, label) };
    });
    const answer = make("output", { className: "answer" }, box);
    const see = (row) => { if (row) table.parentElement.scrollTop = row.offsetTop - table.parentElement.clientHeight / 2; };
    function update() {
      const chosen = inputs.map(({ input, values }) => values[input.value]);
      inputs.forEach(({ input, shown }, i) => { shown.textContent = chosen[i]; input.setAttribute("aria-valuetext", chosen[i]); });
      const found = rows.findIndex((row) => chosen.every((value, i) => row[i] === value));
      answer.textContent = found < 0 ? "not tried" : heads.slice(count).map((head, i) => `${head}: ${rows[found][count + i]}`).join(" · ");
      body.forEach((row, i) => row.classList.toggle("chosen", i === found));
    }
    inputs.forEach(({ input }) => input.addEventListener("input", () => { update(); see(body.find((row) => row.classList.contains("chosen"))); }));
    update();
  }

  function theme() {
    const now = document.documentElement.dataset.theme;
    document.querySelectorAll("iframe.player").forEach((frame) => frame.contentWindow && frame.contentWindow.postMessage({ theme: now }, "*"));
  }

  /* A player says how high it is. */
  addEventListener("message", (event) => {
    const frame = [...document.querySelectorAll("iframe.player")].find((each) => each.contentWindow === event.source);
    if (frame && event.data && event.data.height > 0) frame.style.height = `${event.data.height + 2}px`;
  });

  /* What a phone folds is folded as it comes, so that nothing moves after it was seen. */
  const phone = matchMedia("(max-width: 720px)");
  const fold = (details) => { details.open = !phone.matches; };
  const coming = new MutationObserver((changes) => changes.forEach((change) => change.addedNodes.forEach((node) => {
    if (node.matches && node.matches("details.fold")) fold(node);
  })));
  coming.observe(document, { childList: true, subtree: true });
  phone.addEventListener("change", () => document.querySelectorAll("details.fold").forEach(fold));

  document.addEventListener("DOMContentLoaded", () => {
    document.querySelectorAll("figure.plate").forEach((figure) => {
      const svg = figure.querySelector("svg.chart");
      if (!svg) return;
      const script = svg.querySelector("script.chart-data");
      if (script) tellValues(figure, svg, JSON.parse(script.textContent));
      make("button", { type: "button", className: "enlarge", textContent: "Enlarge", onclick: () => enlarge(figure, svg) }, figure);
    });
    document.querySelectorAll("table[data-explore]").forEach(explore);
    /* The flight that is chosen once is shown everywhere. */
    document.querySelectorAll(".flights > input").forEach((input) => input.addEventListener("change", () => {
      const top = input.getBoundingClientRect().top;
      document.querySelectorAll(`.flights > input[value="${input.value}"]`).forEach((other) => { other.checked = true; });
      scrollBy({ top: input.getBoundingClientRect().top - top, behavior: "instant" });
    }));
    coming.disconnect();
    document.querySelectorAll("iframe.player").forEach((frame) => frame.addEventListener("load", theme));
    new MutationObserver(theme).observe(document.documentElement, { attributes: true, attributeFilter: ["data-theme"] });
    theme();
  });
})();
