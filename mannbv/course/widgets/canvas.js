// Panels in data coordinates on one canvas, and handles: buttons that a mouse drags and the arrow keys nudge.
// Python sends `picture`; a moved handle goes back as {name, x, y, along}. One move is under way at a time, so a slow
// kernel never builds up a queue: of the moves made meanwhile only the last is sent.
const INK = "#222222", PALE = "#8a8a8a", FONT = "12px system-ui, sans-serif";
const STEP = 0.02, TURN = Math.PI / 60, PATIENCE = 3000; // share of an axis, rad and ms a key press

const css = `
.mannbv-canvas { position: relative; width: 100%; background: white; user-select: none; }
.mannbv-canvas canvas { display: block; width: 100%; height: 100%; }
.mannbv-canvas button { position: absolute; width: 18px; height: 18px; margin: -9px 0 0 -9px; padding: 0; border-radius: 9px;
  border: 2px solid white; box-shadow: 0 0 0 1.5px ${INK}; cursor: grab; touch-action: none; }
.mannbv-canvas button:focus-visible { outline: 3px solid #56B4E9; outline-offset: 3px; }
.mannbv-canvas button:active { cursor: grabbing; }`;

const floats = (view) => new Float32Array(view.buffer.slice(view.byteOffset, view.byteOffset + view.byteLength));
const bytes = (view) => new Uint8ClampedArray(view.buffer.slice(view.byteOffset, view.byteOffset + view.byteLength));

// The rectangle [px] a panel's data fill, and the maps between data and pixels.
function frame(panel) {
  let [left, top, width, height] = panel.box;
  const [x0, x1] = panel.x, [y0, y1] = panel.y;
  if (panel.equal) {
    const scale = Math.min(width / Math.abs(x1 - x0), height / Math.abs(y1 - y0));
    const w = scale * Math.abs(x1 - x0), h = scale * Math.abs(y1 - y0);
    [left, top, width, height] = [left + (width - w) / 2, top + (height - h) / 2, w, h];
  }
  const sx = width / (x1 - x0), sy = height / (y1 - y0);
  return {
    left, top, width, height, sx, sy,
    px: (x) => left + (x - x0) * sx, py: (y) => top + height - (y - y0) * sy,
    x: (px) => x0 + (px - left) / sx, y: (py) => y0 + (top + height - py) / sy,
  };
}

function ticks(low, high, count) {
  const rough = (high - low) / Math.max(count, 1), power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= rough * 0.999);
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9)), out = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) out.push([k * step, (k * step).toFixed(digits).replace("-", "−")]);
  return out;
}

const paint = {
  image(ctx, f, item) {
    const [height, width] = item.shape, [x0, x1, y0, y1] = item.extent;
    const small = new OffscreenCanvas(width, height);
    small.getContext("2d").putImageData(new ImageData(bytes(item.rgba), width, height), 0, 0);
    ctx.imageSmoothingEnabled = false;
    ctx.drawImage(small, f.px(x0), f.py(y1), (x1 - x0) * f.sx, (y1 - y0) * f.sy);
  },
  ellipses(ctx, f, item) {
    const shape = floats(item.shapes), color = bytes(item.rgba);
    for (let k = 0; k < shape.length / 5; k++) {
      const [x, y, a, b, angle] = shape.subarray(5 * k, 5 * k + 5), [red, green, blue, alpha] = color.subarray(4 * k, 4 * k + 4);
      ctx.save();
      ctx.transform(f.sx, 0, 0, -f.sy, f.px(x), f.py(y));
      ctx.beginPath();
      ctx.ellipse(0, 0, a, b, angle, 0, 2 * Math.PI);
      ctx.restore();
      ctx.fillStyle = `rgba(${red}, ${green}, ${blue}, ${alpha / 255})`;
      ctx.fill();
      if (item.edge) { ctx.strokeStyle = item.edge; ctx.lineWidth = item.width; ctx.stroke(); }
    }
  },
  line(ctx, f, item) {
    const at = floats(item.points);
    ctx.beginPath();
    let down = false; // a nan lifts the pen
    for (let k = 0; k < at.length; k += 2) {
      const here = !Number.isNaN(at[k]) && !Number.isNaN(at[k + 1]);
      if (here) ctx[down ? "lineTo" : "moveTo"](f.px(at[k]), f.py(at[k + 1]));
      down = here;
    }
    if (item.fill) { ctx.globalAlpha = item.strength; ctx.fillStyle = item.fill; ctx.fill(); ctx.globalAlpha = 1; }
    if (item.color) {
      ctx.strokeStyle = item.color; ctx.lineWidth = item.width; ctx.setLineDash(item.dash); ctx.stroke(); ctx.setLineDash([]);
    }
  },
  dots(ctx, f, item) {
    const at = floats(item.points);
    ctx.fillStyle = item.color;
    for (let k = 0; k < at.length; k += 2) {
      ctx.beginPath();
      ctx.arc(f.px(at[k]), f.py(at[k + 1]), item.size / 2, 0, 2 * Math.PI);
      ctx.fill();
      if (item.edge) { ctx.strokeStyle = item.edge; ctx.lineWidth = 1; ctx.stroke(); }
    }
  },
  text(ctx, f, item) {
    ctx.fillStyle = item.color; ctx.textAlign = item.align; ctx.textBaseline = "middle";
    ctx.fillText(item.text, f.px(item.at[0]), f.py(item.at[1]));
  },
  handle() {},
};

function axes(ctx, panel, f) {
  ctx.strokeStyle = PALE; ctx.lineWidth = 1;
  ctx.beginPath();
  ctx.moveTo(f.left, f.top); ctx.lineTo(f.left, f.top + f.height); ctx.lineTo(f.left + f.width, f.top + f.height);
  ctx.stroke();
  ctx.fillStyle = INK; ctx.textBaseline = "top"; ctx.textAlign = "center";
  for (const [x, label] of panel.xticks ?? ticks(...panel.x, f.width / 70)) {
    ctx.beginPath(); ctx.moveTo(f.px(x), f.top + f.height); ctx.lineTo(f.px(x), f.top + f.height + 4); ctx.stroke();
    ctx.fillText(label, f.px(x), f.top + f.height + 7);
  }
  ctx.textBaseline = "middle"; ctx.textAlign = "right";
  let widest = 0;
  for (const [y, label] of panel.yticks ?? ticks(...panel.y, f.height / 45)) {
    ctx.beginPath(); ctx.moveTo(f.left - 4, f.py(y)); ctx.lineTo(f.left, f.py(y)); ctx.stroke();
    ctx.fillText(label, f.left - 7, f.py(y));
    widest = Math.max(widest, ctx.measureText(label).width);
  }
  ctx.textAlign = "center"; ctx.textBaseline = "top";
  ctx.fillText(panel.xlabel, f.left + f.width / 2, f.top + f.height + 23);
  ctx.textBaseline = "bottom";
  ctx.save(); ctx.translate(f.left - widest - 12, f.top + f.height / 2); ctx.rotate(-Math.PI / 2); ctx.fillText(panel.ylabel, 0, 0); ctx.restore();
  ctx.font = `600 13px system-ui, sans-serif`; ctx.fillText(panel.title, f.left + f.width / 2, f.top - 6 - 18 * (panel.legend.length > 0)); ctx.font = FONT;
  let x = f.left;
  ctx.textAlign = "left"; ctx.textBaseline = "middle";
  for (const [label, color, mark] of panel.legend) {
    ctx.fillStyle = ctx.strokeStyle = color;
    if (mark === "dot") { ctx.beginPath(); ctx.arc(x + 8, f.top - 12, 4, 0, 2 * Math.PI); ctx.fill(); }
    else { ctx.lineWidth = 2; ctx.setLineDash(mark === "dash" ? [5, 3] : []); ctx.beginPath(); ctx.moveTo(x, f.top - 12); ctx.lineTo(x + 16, f.top - 12); ctx.stroke(); ctx.setLineDash([]); }
    ctx.fillStyle = INK;
    ctx.fillText(label, x + 21, f.top - 12);
    x += 21 + ctx.measureText(label).width + 14;
  }
}

function render({ model, el }) {
  const box = document.createElement("div"), canvas = document.createElement("canvas"), style = document.createElement("style");
  box.className = "mannbv-canvas";
  box.dataset.lmSuppressShortcuts = "true"; // else JupyterLab takes the arrow keys
  style.textContent = css;
  canvas.setAttribute("role", "img");
  box.append(style, canvas);
  el.append(box);
  const handles = new Map();
  let waiting = 0, next = null;

  function send(move) {
    const now = performance.now();
    if (waiting && now - waiting < PATIENCE) { next = move; return; }
    waiting = now;
    model.send(move);
  }

  function grip(key) {
    const button = document.createElement("button"), grip = { button };
    let held = false;
    const to = (px, py) => {
      const { f, item } = grip, clip = (v, [a, b]) => Math.min(Math.max(v, a), b);
      const x = item.along === "y" ? item.at[0] : clip(f.x(px), grip.panel.x), y = item.along === "x" ? item.at[1] : clip(f.y(py), grip.panel.y);
      button.style.left = `${(100 * f.px(x)) / model.get("size")[0]}%`;
      button.style.top = `${(100 * f.py(y)) / model.get("size")[1]}%`;
      send({ name: item.name, x, y, along: item.along });
    };
    button.onpointerdown = (event) => { held = true; button.setPointerCapture(event.pointerId); };
    button.onpointermove = (event) => {
      if (!held) return;
      const place = canvas.getBoundingClientRect(), scale = model.get("size")[0] / place.width;
      to((event.clientX - place.left) * scale, (event.clientY - place.top) * scale);
    };
    button.onpointerup = button.onpointercancel = () => { held = false; };
    button.onkeydown = (event) => {
      const [dx, dy] = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key] ?? [0, 0];
      if (!dx && !dy) return;
      event.preventDefault();
      event.stopPropagation();
      const { f, item, panel } = grip, share = STEP * (event.shiftKey ? 0.2 : 1);
      let [x, y] = item.at;
      if (item.about) { // turn: left and up are counterclockwise
        const [cx, cy] = item.about, angle = TURN * (event.shiftKey ? 0.2 : 1) * (dy - dx), [c, s] = [Math.cos(angle), Math.sin(angle)];
        [x, y] = [cx + c * (x - cx) - s * (y - cy), cy + s * (x - cx) + c * (y - cy)];
      } else {
        x += dx * share * (panel.x[1] - panel.x[0]);
        y += dy * share * (panel.y[1] - panel.y[0]);
      }
      to(f.px(x), f.py(y));
    };
    button.dataset.handle = key;
    box.append(button);
    handles.set(key, grip);
    return grip;
  }

  function update() {
    const picture = model.get("picture"), [width, height] = model.get("size"), ratio = window.devicePixelRatio || 1;
    if (!picture.panels) return;
    box.style.maxWidth = `${width}px`;
    box.style.aspectRatio = `${width} / ${height}`;
    if (canvas.width !== Math.round(width * ratio)) { canvas.width = Math.round(width * ratio); canvas.height = Math.round(height * ratio); }
    canvas.setAttribute("aria-label", picture.says);
    const ctx = canvas.getContext("2d");
    ctx.setTransform(ratio, 0, 0, ratio, 0, 0);
    ctx.font = FONT; ctx.lineJoin = "round";
    ctx.fillStyle = "white"; ctx.fillRect(0, 0, width, height);
    const seen = new Set();
    picture.panels.forEach((panel, number) => {
      const f = frame(panel);
      ctx.save();
      ctx.beginPath(); ctx.rect(f.left, f.top, f.width, f.height); ctx.clip();
      for (const item of panel.items) paint[item.kind](ctx, f, item);
      ctx.restore();
      if (panel.axes) axes(ctx, panel, f);
      for (const item of panel.items.filter((item) => item.kind === "handle")) {
        const key = seen.has(item.name) ? `${item.name}-${number}` : item.name, grasp = handles.get(key) ?? grip(key);
        seen.add(key);
        Object.assign(grasp, { f, item, panel });
        grasp.button.style.background = item.color;
        grasp.button.title = grasp.button.ariaLabel = item.label;
        if (!(next && next.name === item.name)) { // a newer move is on its way: do not jump back
          grasp.button.style.left = `${(100 * f.px(item.at[0])) / width}%`;
          grasp.button.style.top = `${(100 * f.py(item.at[1])) / height}%`;
        }
      }
    });
    for (const [key, grasp] of handles) if (!seen.has(key)) { grasp.button.remove(); handles.delete(key); }
    if (waiting) box.dataset.latency = (performance.now() - waiting).toFixed(1); // [ms] from a move to its picture
    box.dataset.step = picture.step;
    waiting = 0;
    if (next) { const move = next; next = null; send(move); }
  }

  model.on("change:picture", update);
  update();
  return () => model.off("change:picture", update);
}

export default { render };
