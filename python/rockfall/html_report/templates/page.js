// SPDX-License-Identifier: BSD-3-Clause
// Maps zoom and move together, by wheel, drag, pinch and keys; figures open large.
"use strict";
{
  const maps = [...document.querySelectorAll(".map svg[tabindex]")];
  const [wide, high] = maps.length ? maps[0].getAttribute("viewBox").split(" ").slice(2).map(Number) : [1, 1];
  const view = { x: 0, y: 0, part: 1 }; // visible: `part` of each side, from cell x, y
  const smallest = Math.min(1, 8 / Math.max(wide, high));
  const clamp = (value, low, high) => Math.min(Math.max(value, low), high);

  function show() {
    view.x = clamp(view.x, 0, wide * (1 - view.part));
    view.y = clamp(view.y, 0, high * (1 - view.part));
    for (const map of maps) {
      map.setAttribute("viewBox", `${view.x} ${view.y} ${wide * view.part} ${high * view.part}`);
      map.classList.toggle("zoomed", view.part < 1);
    }
    rescale();
  }

  // Pixels per cell, on the screen or on paper; 0 for a hidden map.
  let isPrinting = false;
  const pixels = (map) => isPrinting
    ? (map.closest("figure").dataset.printed * 96) / 25.4 / wide
    : map.getScreenCTM()?.a ?? 0;

  // Texts keep their size on the screen; coordinates and rulers show round numbers at any zoom.
  function rescale() {
    for (const map of maps) {
      const side = pixels(map);
      if (!side) continue;
      map.style.setProperty("--scale", 1 / side);
      const dot = map.dataset.cell / side; // metres
      const length = round(60 * dot), ruler = map.parentElement.querySelector(".ruler");
      ruler.style.width = `${length / dot}px`;
      ruler.textContent = `${length} m`;
    }
    if (!maps.length) return;
    const side = pixels(maps[0]);
    if (side) document.getElementById("hatch").setAttribute("patternTransform", `scale(${1 / side}) rotate(-45)`);
    coordinates();
    if (!isPrinting) part();
  }

  function round(rough) {
    const power = 10 ** Math.floor(Math.log10(rough));
    return power * [1, 2, 5, 10].find((step) => step * power >= rough);
  }

  function drawn(name, attributes, text = "") {
    const one = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const [key, value] of Object.entries(attributes)) one.setAttribute(key, value);
    one.textContent = text;
    return one;
  }

  // Coordinates along the lower and left edges of the visible part.
  function coordinates() {
    const side = pixels(maps[0]), { west, north, cell: size } = maps[0].dataset;
    if (!side) return;
    const step = round((110 * size) / side), tick = 6 / side;
    const bottom = view.y + high * view.part, right = view.x + wide * view.part, all = [];
    for (let e = Math.ceil((+west + view.x * size) / step) * step; e < +west + right * size; e += step) {
      const x = (e - west) / size;
      all.push(drawn("path", { class: "tick", d: `M${x} ${bottom}v${-tick}` }));
      all.push(drawn("text", { class: "coordinate", x, y: bottom - 1.4 * tick, "text-anchor": "middle" }, e.toFixed(0)));
    }
    for (let n = Math.ceil((north - bottom * size) / step) * step; n < north - view.y * size; n += step) {
      const y = (north - n) / size;
      all.push(drawn("path", { class: "tick", d: `M${view.x} ${y}h${tick}` }));
      all.push(drawn("text", { class: "coordinate", x: view.x + 1.4 * tick, y, dy: ".35em" }, n.toFixed(0)));
    }
    document.getElementById("coordinates").replaceChildren(...all);
  }

  // Candidate places of a name, above and below each point.
  function* places(text) {
    const numbers = text.dataset.places.split(" ");
    for (let k = 0; k < numbers.length; k += 2) for (const side of ["-.3em", "1em"]) yield [numbers[k], numbers[k + 1], side];
  }

  // Hide texts that would overlap another text or the frame.
  function part() {
    const frame = maps[0].getBoundingClientRect();
    const fixed = [...maps[0].parentElement.querySelectorAll(".north, .ruler")];
    const taken = fixed.map((one) => one.getBoundingClientRect());
    const isFree = (box) => box.left >= frame.left && box.right <= frame.right && box.top >= frame.top && box.bottom <= frame.bottom
      && !taken.some((one) => box.left < one.right && one.left < box.right && box.top < one.bottom && one.top < box.bottom);
    for (const text of maps[0].querySelectorAll("text")) {
      for (const [x, y, side] of text.dataset.places ? places(text) : []) {
        for (const [name, value] of [["x", x], ["y", y], ["dy", side]]) text.setAttribute(name, value);
        if (isFree(text.getBoundingClientRect())) break;
      }
      const box = text.getBoundingClientRect(), free = isFree(box);
      text.style.visibility = free ? "" : "hidden";
      if (free) taken.push(box);
    }
  }

  function zoom(factor, at) {
    const part = factor ? clamp(view.part / factor, smallest, 1) : 1;
    const ratio = part / view.part;
    view.x = at.x - (at.x - view.x) * ratio;
    view.y = at.y - (at.y - view.y) * ratio;
    view.part = part;
    show();
  }

  const cell = (map, x, y) => new DOMPoint(x, y).matrixTransform(map.getScreenCTM().inverse());
  const middle = () => ({ x: view.x + (wide * view.part) / 2, y: view.y + (high * view.part) / 2 });

  // Values of a map, unpacked on first use.
  const unpack = async (map) => new DataView(await inflated(map.dataset.values).arrayBuffer());
  function inflated(text) {
    const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate")));
  }
  const numbers = new Map();

  async function tell(map, at) {
    const output = map.closest("figure").querySelector("output");
    const { west, north, cell: size, unit, values } = map.dataset;
    const [column, row] = [Math.floor(at.x), Math.floor(at.y)];
    const x = (+west + at.x * size).toFixed(1), y = (north - at.y * size).toFixed(1);
    let text = `x ${x} m, y ${y} m`;
    if (values && window.DecompressionStream && column >= 0 && row >= 0 && column < wide && row < high) {
      if (!numbers.has(map)) numbers.set(map, unpack(map));
      const value = (await numbers.get(map)).getFloat32(4 * (row * wide + column), true);
      const known = value.toLocaleString(document.documentElement.lang, { maximumSignificantDigits: value < 1000 ? 3 : 5, useGrouping: false });
      text += Number.isNaN(value) ? `: ${map.dataset.none}` : `: ${known} ${unit}`;
    }
    output.textContent = text;
  }

  for (const map of maps) {
    const held = new Map(); // pressed pointers and their screen positions
    map.addEventListener("wheel", (event) => {
      const zooms = event.ctrlKey || document.activeElement === map; // true for a pinch gesture
      if (!zooms || (event.deltaY > 0 && view.part === 1)) return; // let the page scroll
      event.preventDefault();
      zoom(Math.exp(clamp(-event.deltaY, -240, 240) / 400), cell(map, event.clientX, event.clientY));
    }, { passive: false });
    map.addEventListener("dblclick", (event) => zoom(2, cell(map, event.clientX, event.clientY)));
    map.addEventListener("pointerdown", (event) => {
      held.set(event.pointerId, event);
      if (view.part < 1 || held.size > 1) map.setPointerCapture(event.pointerId);
    });
    for (const end of ["pointerup", "pointercancel", "pointerleave"])
      map.addEventListener(end, (event) => held.delete(event.pointerId));
    map.addEventListener("pointermove", (event) => {
      const before = held.get(event.pointerId);
      if (before) {
        const others = [...held.values()].filter((one) => one.pointerId !== event.pointerId);
        const from = cell(map, before.clientX, before.clientY), to = cell(map, event.clientX, event.clientY);
        held.set(event.pointerId, event);
        if (others.length) {
          const apart = (one) => Math.hypot(one.clientX - others[0].clientX, one.clientY - others[0].clientY);
          zoom(apart(event) / Math.max(apart(before), 1), cell(map, others[0].clientX, others[0].clientY));
        } else if (view.part < 1) {
          view.x += from.x - to.x;
          view.y += from.y - to.y;
          show();
        }
      }
      tell(map, cell(map, event.clientX, event.clientY));
    });
    map.addEventListener("keydown", (event) => {
      const move = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
      const factor = { "+": 1.5, "=": 1.5, "-": 1 / 1.5, "0": 0 }[event.key];
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      if (move && view.part < 1) {
        view.x += 0.15 * wide * view.part * move[0];
        view.y += 0.15 * high * view.part * move[1];
        show();
      } else if (factor !== undefined) zoom(factor, middle());
      else return;
      event.preventDefault();
      tell(map, middle());
    });
    for (const button of map.closest("figure").querySelectorAll("[data-zoom]"))
      button.addEventListener("click", () => zoom(+button.dataset.zoom, middle()));
  }
  addEventListener("resize", rescale);
  addEventListener("beforeprint", () => { isPrinting = true; zoom(0, middle()); });
  addEventListener("afterprint", () => { isPrinting = false; rescale(); });
  rescale();

  const terrain = document.getElementById("terrain");
  terrain?.querySelector("button").addEventListener("click", async () => {
    const frame = document.createElement("iframe");
    frame.title = terrain.textContent;
    frame.srcdoc = await inflated(document.getElementById("terrain-page").textContent).text();
    terrain.replaceChildren(frame);
    terrain.classList.add("shown");
  });

  const dialog = document.querySelector("dialog");
  for (const button of document.querySelectorAll(".picture button"))
    button.addEventListener("click", () => {
      dialog.querySelector("div").replaceChildren(button.querySelector("img").cloneNode());
      dialog.showModal();
    });
  dialog.addEventListener("click", (event) => {
    if (event.target.tagName !== "IMG") dialog.close();
  });
}
