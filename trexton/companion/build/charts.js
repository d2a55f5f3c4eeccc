/* Charts that enlarge, flights that are chosen once, the player's theme and height. No library. */
(function () {
  "use strict";
  function make(name, properties, parent) {
    const element = document.createElement(name);
    Object.assign(element, properties);
    if (parent) parent.append(element);
    return element;
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
      /* On a phone it scrolls, and what scrolls is reached by keys. */
      figure.tabIndex = 0;
      figure.setAttribute("role", "group");
      figure.setAttribute("aria-label", "Chart");
      make("button", { type: "button", className: "enlarge", textContent: "Enlarge", onclick: () => enlarge(figure, svg) }, figure);
    });
    /* Frames of a figure are chosen without a script; with one they also play. */
    document.querySelectorAll("fieldset.steps").forEach((steps) => {
      const inputs = [...steps.querySelectorAll("input")];
      let timer = 0;
      const stop = () => { clearInterval(timer); timer = 0; button.textContent = "Play"; };
      const next = () => { inputs[(inputs.findIndex((each) => each.checked) + 1) % inputs.length].checked = true; };
      const button = make("button", { type: "button", textContent: "Play", onclick: () => {
        if (timer) { stop(); return; }
        next(); timer = setInterval(next, 900); button.textContent = "Stop";
      } }, steps);
      steps.addEventListener("change", stop);
    });
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
