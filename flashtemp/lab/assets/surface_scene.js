// Block and road as boxes whose faces are images of temperature.  The view is orthographic, so every face is an affine
// image on a plain canvas: exact, without WebGL.  Bodies lie above or below z = 0, which gives the order of drawing.
const AXES = ["x", "y", "z"], START = {azimuth: -62, elevation: 24, zoom: 1, right: 0, up: 0};
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

export default {
    template: `<div class="ft-scene"><canvas ref="canvas" tabindex="0" role="application" :aria-label="about"
        aria-roledescription="3D view"></canvas><div ref="readout" class="ft-small ft-muted ft-scene-readout"></div></div>`,
    props: {about: String},
    mounted() {
        this.view = {...START}; this.stretch = 1; this.lift = 0; this.faces = [];
        this.canvas = this.$refs.canvas;
        this.hint = "Drag or use the arrow keys to turn, + and - to zoom, Home to reset; point at a face to read it.";
        this.$refs.readout.textContent = this.hint;
        this.sizes = new ResizeObserver(() => this.draw()); this.sizes.observe(this.canvas);
        this.scheme = new MutationObserver(() => this.draw());
        this.scheme.observe(document.body, {attributes: true, attributeFilter: ["class"]});
        this.canvas.addEventListener("pointerdown", (e) => { this.held = [e.clientX, e.clientY, {...this.view}];
            this.canvas.setPointerCapture(e.pointerId); this.canvas.focus(); });
        this.canvas.addEventListener("pointerup", () => { this.held = null; });
        this.canvas.addEventListener("pointermove", (e) => this.held ? this.drag(e) : this.read(e));
        this.canvas.addEventListener("pointerleave", () => { this.$refs.readout.textContent = this.hint; });
        this.canvas.addEventListener("wheel", (e) => { if (document.activeElement !== this.canvas) return;
            e.preventDefault(); this.turn({zoom: this.view.zoom * Math.exp(-e.deltaY / 600)}); }, {passive: false});
        this.canvas.addEventListener("keydown", (e) => this.press(e));
    },
    unmounted() { this.sizes.disconnect(); this.scheme.disconnect(); },
    methods: {
        show_faces(scene) {  // {faces, low, high, colours}: temperatures as 16-bit numbers from low to high
            const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
            Object.assign(this, {low: scene.low, high: scene.high, colours: bytes(scene.colours)});
            this.faces = scene.faces.map((face) => {
                const [nu, nv] = face.shape, raw = new Uint16Array(bytes(face.T).buffer);
                const image = new ImageData(nu, nv);
                for (let i = 0; i < nu; i++) for (let j = 0; j < nv; j++) {
                    const k = 3 * (raw[i * nv + j] >> 8), at = 4 * (j * nu + i);
                    image.data.set([this.colours[k], this.colours[k + 1], this.colours[k + 2], 255], at);
                }
                const texture = document.createElement("canvas"); texture.width = nu; texture.height = nv;
                texture.getContext("2d").putImageData(image, 0, 0);
                return {...face, raw, texture};
            });
            this.draw();
        },
        set_shape(stretch, lift) { this.stretch = stretch; this.lift = lift; this.draw(); },
        reset_view() { this.view = {...START}; this.draw(); },
        save_image(name) { this.canvas.toBlob((blob) => { const a = document.createElement("a");
            a.href = URL.createObjectURL(blob); a.download = name; a.click();
            setTimeout(() => URL.revokeObjectURL(a.href), 1000); }); },
        turn(change) {
            Object.assign(this.view, change);
            this.view.elevation = Math.max(-89, Math.min(89, this.view.elevation));
            this.view.zoom = Math.max(0.3, Math.min(20, this.view.zoom));
            this.draw();
        },
        drag(e) {
            const [x, y, from] = this.held, right = e.clientX - x, down = e.clientY - y;
            this.turn(e.shiftKey ? {right: from.right + right, up: from.up + down}
                : {azimuth: from.azimuth - 0.4 * right, elevation: from.elevation + 0.4 * down});
        },
        press(e) {
            const v = this.view, steps = {
                ArrowLeft: {azimuth: v.azimuth + 5}, ArrowRight: {azimuth: v.azimuth - 5},
                ArrowUp: {elevation: v.elevation + 5}, ArrowDown: {elevation: v.elevation - 5},
                "+": {zoom: 1.15 * v.zoom}, "=": {zoom: 1.15 * v.zoom}, "-": {zoom: v.zoom / 1.15}, Home: START};
            if (!(e.key in steps)) return;
            e.preventDefault(); this.turn(steps[e.key]);
        },
        corner(body, side) {  // of a body as it is drawn, with z stretched and the block lifted
            const face = this.faces.find((f) => f.body === body), at = [...face[side ? "high" : "low"]];
            at[2] = at[2] * this.stretch + (body === "block" ? this.lift : 0);
            return at;
        },
        project() {  // directions of the picture, and its scale and middle in pixels
            const a = this.view.azimuth * Math.PI / 180, e = this.view.elevation * Math.PI / 180;
            const toward = [Math.cos(e) * Math.cos(a), Math.cos(e) * Math.sin(a), Math.sin(e)];
            const right = [-Math.sin(a), Math.cos(a), 0];
            const up = [-Math.sin(e) * Math.cos(a), -Math.sin(e) * Math.sin(a), Math.cos(e)];
            const low = this.corner("road", 0), high = this.corner("road", 1), top = this.corner("block", 1);
            for (const k of [0, 1, 2]) high[k] = Math.max(high[k], top[k]);
            const middle = low.map((v, k) => 0.5 * (v + high[k])), size = low.map((v, k) => high[k] - v);
            const span = (axis) => size.reduce((sum, s, k) => sum + s * Math.abs(axis[k]), 0);
            const width = this.canvas.clientWidth, height = this.canvas.clientHeight;
            const scale = this.view.zoom * Math.min((width - 230) / span(right), (height - 120) / span(up));
            const place = (p) => { const q = p.map((v, k) => v - middle[k]); return [
                (width - 90) / 2 + this.view.right + scale * dot(q, right),
                height / 2 - 6 + this.view.up - scale * dot(q, up)]; };
            return {toward, place, low, high};
        },
        visible(seen) {  // faces turned to the viewer, from back to front, with their affine maps
            const order = seen.toward[2] >= 0 ? ["road", "block"] : ["block", "road"];
            return order.flatMap((body) => this.faces.filter((f) => f.body === body
                && (f.side ? 1 : -1) * seen.toward[f.axis] > 1e-9).map((f) => {
                const low = this.corner(body, 0), high = this.corner(body, 1), [u, v] = [0, 1, 2].filter((k) => k !== f.axis);
                const at = [...low], alongU = [...low], alongV = [...low];
                for (const p of [at, alongU, alongV]) p[f.axis] = f.side ? high[f.axis] : low[f.axis];
                alongU[u] = high[u]; alongV[v] = high[v];
                const [o, p, q] = [at, alongU, alongV].map(seen.place);
                return {f, u, v, o, eu: [p[0] - o[0], p[1] - o[1]], ev: [q[0] - o[0], q[1] - o[1]]};
            }));
        },
        draw() {
            const ctx = this.canvas.getContext("2d"), zoom = window.devicePixelRatio || 1;
            const css = getComputedStyle(document.body), colour = (name) => css.getPropertyValue(name).trim();
            this.canvas.width = zoom * this.canvas.clientWidth; this.canvas.height = zoom * this.canvas.clientHeight;
            ctx.fillStyle = colour("--surface"); ctx.fillRect(0, 0, this.canvas.width, this.canvas.height);
            if (!this.faces.length) return;
            const seen = this.project();
            ctx.lineWidth = 1; ctx.strokeStyle = colour("--muted");
            for (const {f, o, eu, ev} of this.visible(seen)) {
                const [nu, nv] = f.shape;
                ctx.setTransform(zoom * eu[0] / nu, zoom * eu[1] / nu, zoom * ev[0] / nv, zoom * ev[1] / nv,
                    zoom * o[0], zoom * o[1]);
                ctx.drawImage(f.texture, 0, 0);
                ctx.setTransform(zoom, 0, 0, zoom, 0, 0);
                ctx.beginPath(); ctx.moveTo(...o); ctx.lineTo(o[0] + eu[0], o[1] + eu[1]);
                ctx.lineTo(o[0] + eu[0] + ev[0], o[1] + eu[1] + ev[1]); ctx.lineTo(o[0] + ev[0], o[1] + ev[1]);
                ctx.closePath(); ctx.stroke();
            }
            ctx.setTransform(zoom, 0, 0, zoom, 0, 0);
            ctx.font = "12px system-ui, sans-serif"; ctx.fillStyle = ctx.strokeStyle = colour("--text");
            this.drawAxes(ctx, seen); this.drawScale(ctx);
        },
        ticks(low, high, count) {  // round values from low to high
            const raw = (high - low) / count, power = 10 ** Math.floor(Math.log10(raw));
            const step = [1, 2, 5, 10].find((s) => s * power >= raw) * power, out = [];
            for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) out.push(k * step);
            return out.map((v) => Number(v.toPrecision(6)));
        },
        drawAxes(ctx, {place, toward, low, high}) {
            const near = [0, 1, 2].map((k) => toward[k] > 0 ? high[k] : low[k]);
            const far = [0, 1, 2].map((k) => toward[k] > 0 ? low[k] : high[k]);
            const corners = [[near[0], far[1]], [far[0], near[1]]].sort((a, b) => place([...a, 0])[0] - place([...b, 0])[0]);
            const base = toward[2] >= 0 ? near : far, centre =  // edges of the outline, seen from above or from below
                place(low.map((v, k) => 0.5 * (v + high[k])));
            const road = this.faces.find((f) => f.body === "road"), block = this.faces.find((f) => f.body === "block");
            const lines = [
                [[road.low[0], road.high[0]], (v) => [v, base[1], low[2]]],
                [[road.low[1], road.high[1]], (v) => [base[0], v, low[2]]],
                [[road.low[2], block.high[2]], (v) => [...corners[0], v * this.stretch + (v > 0 ? this.lift : 0)]]];
            ctx.textAlign = "center"; ctx.textBaseline = "middle";
            lines.forEach(([[from, to], at], k) => {
                const [a, b] = [at(from), at(to)].map(place), length = Math.hypot(b[0] - a[0], b[1] - a[1]);
                if (length < 30) return;
                let out = [-(b[1] - a[1]) / length, (b[0] - a[0]) / length];
                if (dot([...out, 0], [0.5 * (a[0] + b[0]) - centre[0], 0.5 * (a[1] + b[1]) - centre[1], 0]) < 0)
                    out = out.map((v) => -v);
                for (const v of this.ticks(1e3 * from, 1e3 * to, Math.max(2, Math.min(6, length / 45)))) {
                    const p = place(at(v / 1e3));
                    ctx.beginPath(); ctx.moveTo(...p); ctx.lineTo(p[0] + 5 * out[0], p[1] + 5 * out[1]); ctx.stroke();
                    ctx.fillText(String(v).replace("-", "\u2212"), p[0] + 16 * out[0], p[1] + 14 * out[1]);
                }
                const m = [0.5 * (a[0] + b[0]) + 42 * out[0], 0.5 * (a[1] + b[1]) + 34 * out[1]];
                ctx.fillText(`${AXES[k]} (mm)`, ...m);
            });
        },
        drawScale(ctx) {
            const x = this.canvas.clientWidth - 78, top = 30, height = this.canvas.clientHeight - 60, n = 256;
            for (let k = 0; k < n; k++) {
                ctx.fillStyle = `rgb(${this.colours[3 * k]},${this.colours[3 * k + 1]},${this.colours[3 * k + 2]})`;
                ctx.fillRect(x, top + height * (1 - (k + 1) / n), 14, height / n + 1);
            }
            ctx.fillStyle = ctx.strokeStyle; ctx.strokeRect(x, top, 14, height);
            ctx.textAlign = "left"; ctx.fillText("°C", x, top - 14);
            for (const T of this.ticks(this.low, this.high, 6)) {
                const y = top + height * (1 - (T - this.low) / (this.high - this.low));
                ctx.beginPath(); ctx.moveTo(x + 14, y); ctx.lineTo(x + 19, y); ctx.stroke();
                ctx.fillText(String(T), x + 23, y);
            }
        },
        read(e) {  // the temperature of the foremost face under the pointer
            if (!this.faces.length) return;
            const box = this.canvas.getBoundingClientRect(), at = [e.clientX - box.left, e.clientY - box.top];
            for (const {f, u, v, o, eu, ev} of this.visible(this.project()).reverse()) {
                const d = [at[0] - o[0], at[1] - o[1]], det = eu[0] * ev[1] - eu[1] * ev[0];
                const a = (d[0] * ev[1] - d[1] * ev[0]) / det, b = (eu[0] * d[1] - eu[1] * d[0]) / det;
                if (!(a >= 0 && a < 1 && b >= 0 && b < 1)) continue;
                const p = [...(f.side ? f.high : f.low)], [nu, nv] = f.shape;
                p[u] = f.low[u] + a * (f.high[u] - f.low[u]); p[v] = f.low[v] + b * (f.high[v] - f.low[v]);
                const raw = f.raw[Math.floor(a * nu) * nv + Math.floor(b * nv)];
                const T = this.low + raw / 65535 * (this.high - this.low);
                const where = AXES.map((n, k) => `${n} = ${(1e3 * p[k]).toFixed(2)} mm`).join(", ");
                this.$refs.readout.textContent = `${f.body}: ${T.toFixed(2)} °C at ${where}`;
                return;
            }
            this.$refs.readout.textContent = this.hint;
        },
    },
};
