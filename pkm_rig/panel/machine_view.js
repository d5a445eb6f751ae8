// The machine in three dimensions on a canvas: lines, balls and one mesh, painted from the back to the front.
// Everything that is seen comes as one object of numbers; nothing is drawn unless it has changed.
const COLOURS = {
  strut: "#5c677d", slider: "#1d2733", platform: "#8d99ae", reflector: "#e09f3e", aimed: "#d1495b", station: "#2a6f97",
  sight: "#d1495b", tool: "#1d2733", target: "#2a6f97", frame: "#c9d1dc",
};
export default {
  template: `<canvas class="machine-view" role="img" aria-label="the machine, as the drives say it stands" style="width:100%;height:100%;touch-action:none;cursor:grab"></canvas>`,
  mounted() {
    this.scene = null;
    this.mesh = null;
    this.yaw = 0.55;
    this.pitch = 0.3;
    this.zoom = 1;
    this.queued = false;
    this.drag = null;
    const canvas = this.$el;
    canvas.addEventListener("pointerdown", (e) => { this.drag = [e.clientX, e.clientY]; canvas.setPointerCapture(e.pointerId); });
    canvas.addEventListener("pointermove", (e) => {
      if (!this.drag) return;
      this.yaw += (e.clientX - this.drag[0]) * 0.01;
      this.pitch = Math.max(-1.5, Math.min(1.5, this.pitch + (e.clientY - this.drag[1]) * 0.01));
      this.drag = [e.clientX, e.clientY];
      this.queue();
    });
    canvas.addEventListener("pointerup", () => { this.drag = null; });
    canvas.addEventListener("wheel", (e) => {
      e.preventDefault();
      this.zoom = Math.max(0.4, Math.min(5, this.zoom * Math.exp(-e.deltaY * 0.001)));
      this.queue();
    }, { passive: false });
    this.watch = new ResizeObserver(() => this.queue());
    this.watch.observe(canvas);
  },
  unmounted() { this.watch.disconnect(); },
  methods: {
    show(scene) { this.scene = scene; this.queue(); },
    field(mesh) { this.mesh = mesh; this.queue(); },
    queue() {
      if (this.queued) return;
      this.queued = true;
      requestAnimationFrame(() => { this.queued = false; this.draw(); });
    },
    // Names over everything else, whole and beside one another: each takes the first place round its ball that is free.
    label(g, named, wide, high) {
      g.font = "12px system-ui, sans-serif";
      const taken = [];
      for (const [name, [x, y], size] of named) {
        const long = g.measureText(name).width, tall = 13, away = size + 4;
        const tries = [[x + away, y - away], [x + away, y + away + tall], [x - away - long, y - away], [x - away - long, y + away + tall], [x - long / 2, y - away - tall], [x - long / 2, y + away + 2 * tall]];
        const boxes = tries.map(([left, base]) => [Math.max(2, Math.min(left, wide - long - 2)), Math.max(tall, Math.min(base, high - 3))]);
        const free = ([left, base]) => taken.every(([l, b, w]) => left > l + w + 4 || l > left + long + 4 || Math.abs(base - b) > tall);
        const [left, base] = boxes.find(free) || boxes[0];
        taken.push([left, base, long]);
        g.lineWidth = 3; g.strokeStyle = "rgba(255, 255, 255, 0.8)"; g.strokeText(name, left, base);
        g.fillStyle = "#1d2733"; g.fillText(name, left, base);
      }
      this.$el.dataset.labels = JSON.stringify(taken.map((box) => box.map(Math.round)));
    },
    draw() {
      const canvas = this.$el, wide = canvas.clientWidth, high = canvas.clientHeight;
      if (!this.scene || !wide || !high) return;
      const dense = window.devicePixelRatio || 1;
      if (canvas.width !== Math.round(wide * dense)) canvas.width = Math.round(wide * dense);
      if (canvas.height !== Math.round(high * dense)) canvas.height = Math.round(high * dense);
      const g = canvas.getContext("2d");
      g.setTransform(dense, 0, 0, dense, 0, 0);
      g.clearRect(0, 0, wide, high);
      const [cx, cy, cz] = this.scene.centre, away = 3.2 * this.scene.radius;
      const scale = (this.zoom * 0.64 * Math.min(wide, high * 1.2) * away) / this.scene.radius;
      const cosYaw = Math.cos(this.yaw), sinYaw = Math.sin(this.yaw), cosPitch = Math.cos(this.pitch), sinPitch = Math.sin(this.pitch);
      const project = ([x, y, z]) => {
        const X = x - cx, Y = y - cy, Z = z - cz;
        const right = cosYaw * X - sinYaw * Z, back = sinYaw * X + cosYaw * Z;
        const up = cosPitch * Y - sinPitch * back, near = sinPitch * Y + cosPitch * back;
        const depth = Math.max(away - near, 0.05 * away);
        return [wide / 2 + (scale * right) / depth, high / 2 - (scale * up) / depth, depth, scale / depth];
      };
      const things = [];
      for (const [from, to, kind, width] of this.scene.lines) {
        const a = project(from), b = project(to);
        things.push([(a[2] + b[2]) / 2, () => {
          g.strokeStyle = COLOURS[kind]; g.lineWidth = width; g.setLineDash(kind === "sight" ? [6, 5] : []);
          g.beginPath(); g.moveTo(a[0], a[1]); g.lineTo(b[0], b[1]); g.stroke(); g.setLineDash([]);
        }]);
      }
      const named = [];
      for (const [at, kind, radius, name] of this.scene.balls) {
        const a = project(at), size = Math.max(2.5, radius * a[3]);
        things.push([a[2] - 0.01, () => {
          g.fillStyle = COLOURS[kind]; g.beginPath(); g.arc(a[0], a[1], size, 0, 7);
          if (kind === "target") { g.strokeStyle = COLOURS[kind]; g.lineWidth = 2.5; g.stroke(); } else g.fill();
        }]);
        if (name) named.push([name, a, size]);
      }
      if (this.mesh) {
        const { columns, places, shares } = this.mesh, at = places.map(project);
        for (let i = 0; i + columns < places.length; i++) {
          if ((i + 1) % columns === 0) continue;
          const corners = [at[i], at[i + 1], at[i + columns + 1], at[i + columns]];
          const share = (shares[i] + shares[i + 1] + shares[i + columns] + shares[i + columns + 1]) / 4;
          things.push([corners[0][2] + 0.02, () => {
            g.fillStyle = `rgba(${Math.round(38 + 186 * share)}, ${Math.round(70 + 105 * share)}, ${Math.round(150 - 70 * share)}, 0.55)`;
            g.beginPath(); corners.forEach((c, n) => (n ? g.lineTo(c[0], c[1]) : g.moveTo(c[0], c[1]))); g.closePath(); g.fill();
          }]);
        }
      }
      things.sort((a, b) => b[0] - a[0]).forEach(([, paint]) => paint());
      this.label(g, named, wide, high);
      canvas.dataset.objects = this.scene.lines.length + this.scene.balls.length + (this.mesh ? 1 : 0);
      canvas.dataset.drawn = (Number(canvas.dataset.drawn) || 0) + 1;
    },
  },
};
