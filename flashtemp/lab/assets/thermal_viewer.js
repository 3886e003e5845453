// Image of temperatures: frames come as 32-bit floats and are coloured here, so that range, palette, isotherm, zoom,
// playback and measurements follow without a request. Viewers of one group share range, palette, zoom, frame, cursor.
const MISSING = [208, 208, 208], BAD = [0, 213, 213], ISOTHERM = [0, 230, 118];
const GRIP_PX = 12, CACHE_BYTES = 96e6, PREFETCH = 3, MAX_ZOOM = 32, MAGNIFIED_PX = 15, EVENT_MS = 200, DRAG_MS = 60;
const MEASURED = "#FFFFFF";
const KEYED = { spot: [[0.5, 0.5]], box: [[0.4, 0.4], [0.6, 0.6]], line: [[0.3, 0.5], [0.7, 0.5]] };
const groups = new Map();

const clamp = (value, low, high) => Math.min(Math.max(value, low), high);

function roundStep(span, count) {
  const raw = span / count, power = 10 ** Math.floor(Math.log10(raw));
  return power * ([1, 2, 5].find((m) => m * power >= raw) ?? 10);
}

// a colour as the 32 bits of one pixel of an image, whose bytes are red, green, blue, opacity
const pack = ([red, green, blue]) => new Uint32Array(new Uint8Array([red, green, blue, 255]).buffer)[0];

function colourTable(colours) {
  const rgb = colours.map((c) => [1, 3, 5].map((k) => parseInt(c.slice(k, k + 2), 16)));
  return Uint32Array.from({ length: 256 }, (_, k) => {
    const at = (k / 255) * (rgb.length - 1), low = Math.min(Math.floor(at), rgb.length - 2);
    return pack(rgb[low].map((c, n) => Math.round(c + (at - low) * (rgb[low + 1][n] - c))));
  });
}

function quantiles(values, fractions) {
  const every = Math.max(1, Math.floor(values.length / 20000)), some = [];
  for (let k = 0; k < values.length; k += every) if (Number.isFinite(values[k])) some.push(values[k]);
  some.sort((a, b) => a - b);
  return some.length ? fractions.map((f) => some[Math.round(f * (some.length - 1))]) : [0, 1];
}

const PACKED = [MISSING, BAD, ISOTHERM].map(pack);

export default {
  template: `
    <div class="tv" ref="root" @keydown="pressKey">
      <div v-if="!compact" class="tv-bar" role="toolbar" aria-label="tools of the image">
        <div class="tv-group" role="radiogroup" aria-label="tool">
          <q-btn v-for="t in tools" :key="t.name" :icon="t.icon" :label="t.label" dense no-caps role="radio"
                 :aria-checked="tool === t.name ? 'true' : 'false'" :flat="tool !== t.name" unelevated
                 :color="tool === t.name ? 'primary' : undefined" @click="tool = t.name">
            <q-tooltip>{{ t.help }}</q-tooltip></q-btn>
        </div>
        <div class="tv-group">
          <q-btn icon="remove" flat dense aria-label="zoom out" :disable="zoom <= 1" @click="zoomBy(0.5)"/>
          <span class="tv-zoom">{{ Math.round(100 * zoom) }} %</span>
          <q-btn icon="add" flat dense aria-label="zoom in" :disable="zoom >= 32" @click="zoomBy(2)"/>
          <q-btn icon="fit_screen" flat dense aria-label="fit the image" @click="fit"/>
          <q-btn icon="download" flat dense aria-label="save the image">
            <q-tooltip>save the image</q-tooltip>
            <q-menu><q-list>
              <q-item v-for="[words, save] in exports" clickable v-close-popup @click="save()">
                <q-item-section>{{ words }}</q-item-section></q-item>
            </q-list></q-menu></q-btn>
        </div>
      </div>
      <div v-if="!compact" class="tv-bar">
        <q-select v-model="palette" :options="paletteOptions" emit-value map-options outlined dense options-dense
                  label="palette" class="tv-w3" @update:model-value="share"/>
        <q-select v-model="rangeMode" :options="rangeOptions" emit-value map-options outlined dense options-dense
                  label="range" class="tv-w4" @update:model-value="applyRange"/>
        <q-input :model-value="show(low)" @change="typeRange('low', $event)" outlined dense :label="'from, ' + unit"
                 class="tv-w1"/>
        <q-input :model-value="show(high)" @change="typeRange('high', $event)" outlined dense :label="'to, ' + unit"
                 class="tv-w1"/>
        <q-select v-model="isotherm" :options="['off', 'above', 'below', 'between']" outlined dense options-dense
                  label="isotherm" class="tv-w2" @update:model-value="share"/>
        <q-input v-if="isotherm !== 'off'" :model-value="show(isoLow)" @change="typeRange('isoLow', $event)" outlined
                 dense :label="isotherm === 'between' ? 'above, ' + unit : isotherm + ', ' + unit" class="tv-w2"/>
        <q-input v-if="isotherm === 'between'" :model-value="show(isoHigh)" @change="typeRange('isoHigh', $event)"
                 outlined dense :label="'below, ' + unit" class="tv-w2"/>
        <q-toggle v-model="marksBad" dense label="bad pixels" @update:model-value="share"/>
      </div>
      <div v-if="title" class="tv-title">{{ title }}</div>
      <div class="tv-body" :class="{ ruled: rulers.length }" :style="{ maxWidth: 'calc(' + (62 * columns / rows) + 'vh + 84px)' }">
        <div class="tv-image">
          <canvas ref="canvas" class="tv-canvas" :id="imageId" tabindex="0" role="img" :aria-label="described"
                  :class="{ pan: tool === 'pan' }" :style="{ aspectRatio: columns + ' / ' + rows }"
                  @pointerdown="press" @pointermove="move" @pointerup="release" @pointerleave="leave"
                  @wheel="turnWheel" @dblclick="tool === 'pan' && fit()"></canvas>
          <div v-for="(r, n) in rulers" class="tv-ruler" :class="n ? 'up' : 'across'" aria-hidden="true">
            <span v-for="t in r" :style="{ [n ? 'top' : 'left']: t.at + '%' }">{{ t.text }}</span>
            <b>{{ axes[n] }}, mm</b></div>
        </div>
        <div class="tv-scale" role="img" @pointerdown="pressScale" @pointermove="dragScale" @pointerup="scaleEnd = null"
             title="drag the upper or the lower half to change the range" :aria-label="'colours from ' + show(low) + ' to ' + show(high) + ' ' + unit">
          <span class="tv-unit">{{ unit }}</span>
          <div class="tv-gradient" :style="{ background: gradient }">
            <i v-for="b in bands" class="tv-band" :style="b"></i></div>
          <span v-for="t in ticks" class="tv-tick" :style="{ bottom: t.at + '%' }">{{ t.text }}</span>
        </div>
      </div>
      <div class="tv-read ft-mono" data-is="value">{{ readout }}</div>
      <div v-if="fault" class="ft-note error" role="alert">{{ fault }}</div>
      <div v-if="count > 1" class="tv-play">
        <q-btn v-if="!compact" :icon="playing ? 'pause' : 'play_arrow'" flat dense round color="primary"
               :aria-label="playing ? 'pause' : 'play'" @click="toggle"/>
        <div class="tv-axis">
          <input type="range" min="0" :max="count - 1" step="1" :value="frame" aria-label="frame"
                 @input="go(Number($event.target.value))"/>
          <i v-for="e in events" class="tv-event" :class="e.kind" :style="{ left: e.at + '%' }" :title="e.text"></i>
        </div>
        <span class="tv-time">{{ when }}</span>
        <q-select v-if="!compact" v-model="rate" :options="[1, 2, 5, 10, 20, 30]" outlined dense options-dense
                  label="frames/s" class="tv-w2"/>
      </div>
      <div v-if="strip.length && !compact" class="tv-strip" role="group" aria-label="film strip">
        <button v-for="(k, n) in strip" :key="k" type="button" :class="{ here: n === nearest }" @click="go(k)"
                :aria-label="'frame ' + k + ', ' + timeText(k)">
          <canvas :ref="(c) => thumbs[n] = c"></canvas><span>{{ timeText(k) }}</span></button>
      </div>
    </div>`,
  props: {
    address: String, count: Number, rows: Number, columns: Number, times: Array, hasTimes: Boolean, unit: String,
    span: Array, percentiles: Array, palettes: Object, marks: Array, outline: Array, measurements: Array,
    screened: Object, toMillimetres: Array, title: String, imageId: String, magnifierId: String, group: String,
    compact: Boolean, nextMark: String, missingWords: String, axes: Array, frameLabels: Array, storageKey: String,
    kept: Object, fileLabel: String,
  },
  emits: ["frame", "mark", "measure", "restore"],
  data() {
    return {
      tool: this.nextMark ? "mark" : "spot", zoom: 1, left: 0, top: 0, frame: 0, palette: Object.keys(this.palettes)[0], rangeMode: "all",
      low: this.span[0], high: this.span[1], isotherm: "off", isoLow: (this.span[0] + this.span[1]) / 2,
      isoHigh: this.span[1], marksBad: true, cursor: null, value: null, playing: false, rate: 10, fault: "",
    };
  },
  created() {  // large arrays stay out of Vue's observation
    Object.assign(this, {
      cache: new Map(), wanted: new Map(), mask: null, pixels: null, thumbs: [], small: new Map(), drag: null,
      sent: {}, magnified: null, scaleEnd: null, drawn: 0, target: null, going: null,
    });
  },
  computed: {
    tools() {
      const all = [
        ["mark", "highlight_alt", "Edges", "click the edges of the block; drag a mark to correct it"],
        ["spot", "add_circle_outline", "Spot", "click to measure a point; drag it to move it"],
        ["box", "crop_din", "Box", "drag to measure a rectangle; drag it or its corners to change it"],
        ["line", "timeline", "Line", "drag to measure along a line; drag it or its ends to change it"],
        ["pan", "pan_tool", "Pan", "drag to move the zoomed image; with other tools hold shift; double click fits"],
      ];
      const offered = this.nextMark ? all : all.slice(1);  // a recording is marked already
      return offered.map(([name, icon, label, help]) => ({ name, icon, label, help }));
    },
    exports() {
      return [["Image with scale (PNG)", this.savePicture], ["Temperatures of this frame (CSV)", this.saveTable]];
    },
    paletteOptions() { return Object.keys(this.palettes).map((p) => ({ label: p, value: p })); },
    rangeOptions() {
      const all = [["all", "all frames"], ["all98", "all, 1 to 99 %"], ["frame", "this frame"],
                   ["frame98", "this, 1 to 99 %"], ["typed", "as entered"]];
      return all.map(([value, label]) => ({ value, label }));
    },
    decimals() { return clamp(2 - Math.floor(Math.log10(Math.max(this.high - this.low, 1e-6) / 2)), 0, 4); },
    gradient() { return "linear-gradient(to top, " + this.palettes[this.palette].join(", ") + ")"; },
    ticks() {
      const span = this.high - this.low, step = roundStep(span, 6), digits = clamp(-Math.floor(Math.log10(step)), 0, 6);
      const out = [];
      for (let n = Math.ceil(this.low / step - 1e-9); n * step <= this.high + 1e-9 * span; n++)
        out.push({ at: (100 * (n * step - this.low)) / span, text: (n * step).toFixed(digits) });
      return out;
    },
    bands() {
      if (this.isotherm === "off") return [];
      const part = (T) => 100 * clamp((T - this.low) / (this.high - this.low), 0, 1);
      const from = this.isotherm === "below" ? 0 : part(this.isoLow);
      const to = this.isotherm === "below" ? part(this.isoLow) : this.isotherm === "above" ? 100 : part(this.isoHigh);
      return [{ bottom: from + "%", height: Math.max(0, to - from) + "%", background: `rgb(${ISOTHERM})` }];
    },
    described() {
      return `image of temperatures, frame ${this.frame + 1} of ${this.count}, ${this.columns} by ${this.rows} pixels`;
    },
    when() {
      const parts = [`frame ${this.frame} of ${this.count - 1}`, this.hasTimes ? this.timeText(this.frame) : "",
                     this.frameLabels[this.frame] ?? ""];
      return parts.filter(Boolean).join(" · ");
    },
    rulers() {  // ticks in mm along both edges of an image whose axes are those of the block
      const m = this.toMillimetres;
      if (this.axes.length < 2 || m.length !== 9) return [];
      const all = [[this.left, this.columns, m[0], m[2]], [this.top, this.rows, m[4], m[5]]];
      return all.map(([first, count, slope, offset]) => {
        const shown = count / this.zoom, ends = [0, shown].map((d) => slope * (first + d - 0.5) + offset);
        const [low, high] = [Math.min(...ends), Math.max(...ends)], step = roundStep(high - low, 6), ticks = [];
        const digits = clamp(-Math.floor(Math.log10(step)), 0, 6);
        for (let n = Math.ceil(low / step); n * step <= high; n++)
          ticks.push({ at: (100 * ((n * step - offset) / slope + 0.5 - first)) / shown, text: (n * step).toFixed(digits) });
        return ticks;
      });
    },
    readout() {
      if (!this.cursor) return "Move the pointer over the image to read temperatures.";
      const [c, r] = this.cursor, mm = this.millimetres(c, r);
      const place = `column ${c.toFixed(1)}, row ${r.toFixed(1)}`;
      if (mm && this.axes.length) return this.axes.map((a, k) => `${a} ${mm[k].toFixed(2)} mm`).join(", ") + ": " + this.value;
      return place + (mm ? ` · ${mm[0].toFixed(2)}, ${mm[1].toFixed(2)} mm` : "") + ": " + this.value;
    },
    strip() {
      const n = Math.min(16, this.count);
      return n < 2 ? [] : [...Array(n)].map((_, k) => Math.round((k * (this.count - 1)) / (n - 1)));
    },
    nearest() {
      const away = this.strip.map((k) => Math.abs(k - this.frame));
      return away.indexOf(Math.min(...away));
    },
    events() {
      const { shutter = [], frozen = [] } = this.screened ?? {}, last = Math.max(1, this.count - 1);
      const of = (kind, words) => (k) => ({ kind, at: (100 * k) / last, text: `${words}, frame ${k}` });
      return [...shutter.map(of("shutter", "shutter event")), ...frozen.map(of("frozen", "repeats the frame before"))];
    },
  },
  mounted() {
    this.lut = colourTable(this.palettes[this.palette]);
    this.buffer = document.createElement("canvas");
    [this.buffer.width, this.buffer.height] = [this.columns, this.rows];
    this.image = this.buffer.getContext("2d").createImageData(this.columns, this.rows);
    this.watcher = new ResizeObserver(() => this.paint());
    this.watcher.observe(this.$refs.canvas);
    if (!groups.has(this.group)) groups.set(this.group, new Set());
    groups.get(this.group).add(this);
    const first = [...groups.get(this.group)].find((v) => v !== this);
    if (first) this.follow(first.state());
    this.restoreState();
    this.go(this.frame, true).then(() => this.loadStrip());
    this.loadMask();
  },
  unmounted() {
    this.playing = false;
    this.watcher.disconnect();
    groups.get(this.group)?.delete(this);
  },
  watch: {
    palette() { this.lut = colourTable(this.palettes[this.palette]); this.recolour(); },
    low() { this.recolour(); }, high() { this.recolour(); }, isotherm() { this.recolour(); },
    isoLow() { this.recolour(); }, isoHigh() { this.recolour(); }, marksBad() { this.recolour(); },
    zoom() { this.paint(); }, left() { this.paint(); }, top() { this.paint(); },
    marks: { deep: true, handler() { this.paint(); this.magnify(); } },
    outline: { deep: true, handler() { this.paint(); } },
    measurements: { deep: true, handler() { this.draft = null; this.paint(); } },
    screened: { deep: true, handler() { this.loadMask(); } },
    kept: { deep: true, handler() { this.store(this.kept); } },
    tool() { this.store({}); },
  },
  methods: {
    // --- frames ---------------------------------------------------------------------------------------------------
    async fetchFrame(k, step = 1) {
      const answer = await fetch((window.path_prefix ?? "") + `${this.address}/${k}?step=${step}`, { cache: "no-store" });
      if (!answer.ok) throw new Error("These frames are no longer open: reload the page.");
      return answer.arrayBuffer();
    },
    async load(k) {
      if (this.cache.has(k)) {
        const kept = this.cache.get(k);
        this.cache.delete(k); this.cache.set(k, kept);  // the last used is dropped last
        return kept;
      }
      if (!this.wanted.has(k))
        this.wanted.set(k, this.fetchFrame(k).then((bytes) => {
          this.cache.set(k, new Float32Array(bytes));
          while (this.cache.size > Math.max(4, CACHE_BYTES / (4 * this.rows * this.columns)))
            this.cache.delete(this.cache.keys().next().value);
          return this.cache.get(k);
        }).finally(() => this.wanted.delete(k)));
      return this.wanted.get(k);
    },
    async go(k, quiet = false) {  // while a frame is on its way, only the last one asked for follows it
      this.target = [clamp(k, 0, this.count - 1), quiet];
      this.going ??= this.goOn().finally(() => { this.going = null; });
      return this.going;
    },
    async goOn() {
      while (this.target) {
        const [k, quiet] = this.target;
        this.target = null;
        try { this.pixels = await this.load(k); } catch (e) { this.fault = e.message; this.playing = false; return; }
        this.frame = k;
        if (this.rangeMode.startsWith("frame")) this.applyRange();
        this.recolour(false);
        this.$refs.root.dataset.frame = k;
        this.$refs.root.dataset.drawn = ++this.drawn;
        if (quiet) continue;
        if (!this.playing) this.store({});
        this.throttle("frame", EVENT_MS, { frame: k });
        this.tell("followFrame", k, this.hasTimes ? this.times[k] : null);
      }
    },
    async toggle() {
      this.playing = !this.playing;
      let due = performance.now();
      while (this.playing) {
        const next = (this.frame + 1) % this.count;
        for (let n = 1; n <= PREFETCH; n++) this.load((next + n) % this.count).catch(() => {});
        await this.go(next);
        due = Math.max(due + 1000 / this.rate, performance.now() - 1000 / this.rate);
        await new Promise((done) => setTimeout(done, Math.max(0, due - performance.now())));
      }
    },
    async loadStrip() {
      const step = Math.max(1, Math.floor(this.columns / 96));
      for (const k of this.compact ? [] : this.strip) {
        try { this.small.set(k, new Float32Array(await this.fetchFrame(k, step))); } catch { return; }
        this.paintThumbnail(k, step);
      }
      this.smallStep = step;
    },
    async loadMask() {
      if (!this.screened?.version) return;
      try { this.mask = new Uint8Array(await this.fetchFrame("mask")); } catch { return; }
      this.recolour();
    },
    timeText(k) { return this.hasTimes ? Number(this.times[k].toPrecision(4)) + " s" : String(k); },
    show(T) { return Number(T).toFixed(this.decimals); },

    // --- colours --------------------------------------------------------------------------------------------------
    colour(T, bytes, mask) {
      const out = new Uint32Array(bytes.buffer), scale = 255 / Math.max(this.high - this.low, 1e-9);
      const { lut, low, isotherm: iso, isoLow, isoHigh } = this, [missing, bad, banded] = PACKED;
      const from = iso === "off" ? Infinity : iso === "below" ? -Infinity : isoLow;
      const to = iso === "below" ? isoLow : iso === "between" ? isoHigh : Infinity;
      for (let k = 0; k < T.length; k++) {
        const v = T[k], i = (v - low) * scale;
        out[k] = v > from && v < to ? banded : v === v ? lut[i < 0 ? 0 : i > 255 ? 255 : i | 0] : missing;
      }
      if (mask && this.marksBad) for (let k = 0; k < mask.length; k++) if (mask[k]) out[k] = bad;
    },
    recolour(strip = true) {
      if (!this.pixels) return;
      this.colour(this.pixels, this.image.data, this.mask);
      this.buffer.getContext("2d").putImageData(this.image, 0, 0);
      this.paint(); this.readValue(); this.magnify();
      if (strip && this.smallStep) for (const k of this.small.keys()) this.paintThumbnail(k, this.smallStep);
    },
    paintThumbnail(k, step) {
      const canvas = this.thumbs[this.strip.indexOf(k)], T = this.small.get(k);
      if (!canvas) return;
      [canvas.width, canvas.height] = [Math.ceil(this.columns / step), Math.ceil(this.rows / step)];
      const context = canvas.getContext("2d"), image = context.createImageData(canvas.width, canvas.height);
      this.colour(T, image.data, null);
      context.putImageData(image, 0, 0);
    },
    applyRange() {
      const frame = this.rangeMode.startsWith("frame") && this.pixels;
      const both = this.rangeMode === "all" ? this.span : this.rangeMode === "all98" ? this.percentiles
        : frame ? quantiles(this.pixels, this.rangeMode === "frame" ? [0, 1] : [0.01, 0.99]) : [this.low, this.high];
      [this.low, this.high] = [both[0], Math.max(both[1], both[0] + 0.01)];
      this.share();
    },
    typeRange(key, event) {
      const value = Number(String(event.target?.value ?? event).replace(",", "."));
      if (!Number.isFinite(value)) return;
      if (key === "low" || key === "high") {
        this.rangeMode = "typed";
        if ((key === "low" ? this.high - value : value - this.low) < 1e-3) return;
      }
      this[key] = value;
      this.share();
    },

    // --- what a reload of the page keeps ----------------------------------------------------------------------------
    readStored() {
      try { return JSON.parse(sessionStorage.getItem(this.storageKey)) ?? {}; } catch { return {}; }
    },
    store(values) {
      if (!this.storageKey) return;
      const { tool, rangeMode, low, high, frame } = this, image = { ...this.state(), rangeMode, low, high, frame, tool };
      try { sessionStorage.setItem(this.storageKey, JSON.stringify({ ...this.readStored(), ...values, image })); }
      catch { /* a full or forbidden storage: nothing is kept */ }
    },
    restoreState() {
      if (!this.storageKey) return;
      const { image, ...values } = this.readStored();
      if (image?.palette in this.palettes) {
        const { frame, tool, ...state } = image;
        this.follow(state);
        this.frame = clamp(frame | 0, 0, this.count - 1);
        if (this.tools.some((t) => t.name === tool)) this.tool = tool;
      }
      if (Object.keys(values).length) this.$emit("restore", values);
    },

    // --- viewers of one group ---------------------------------------------------------------------------------------
    tell(method, ...values) {
      for (const v of groups.get(this.group) ?? []) if (v !== this) v[method](...values);
    },
    state() {
      const { palette, low, high, rangeMode, isotherm, isoLow, isoHigh, marksBad, zoom, left, top } = this;
      return { palette, low, high, rangeMode: rangeMode.startsWith("all") ? "typed" : rangeMode, isotherm, isoLow, isoHigh,
               marksBad, zoom, left: left / this.columns, top: top / this.rows };
    },
    share() {
      this.tell("follow", { ...this.state(), rangeMode: "typed" });
      this.store({});
    },
    follow(state) {
      Object.assign(this, { ...state, left: state.left * this.columns, top: state.top * this.rows });
    },
    followFrame(k, time) {  // the frame nearest in time where both have times, else that of the same number
      if (time !== null && this.hasTimes) {
        const later = this.times.findIndex((t) => t >= time), n = later < 0 ? this.count - 1 : later;
        k = n > 0 && time - this.times[n - 1] < this.times[n] - time ? n - 1 : n;
      }
      this.go(k, true);
    },
    followCursor(at) { this.cursor = at; this.readValue(); this.paint(); },

    // --- place and value --------------------------------------------------------------------------------------------
    place(event) {
      const box = this.$refs.canvas.getBoundingClientRect();
      return [this.left + ((event.clientX - box.left) / box.width) * (this.columns / this.zoom) - 0.5,
              this.top + ((event.clientY - box.top) / box.height) * (this.rows / this.zoom) - 0.5];
    },
    pagePixels(at) {  // of a place, from the corner of the canvas
      const box = this.$refs.canvas.getBoundingClientRect(), size = (this.zoom * box.width) / this.columns;
      return [(at[0] + 0.5 - this.left) * size, (at[1] + 0.5 - this.top) * size];
    },
    near(a, b) {
      const [p, q] = [this.pagePixels(a), this.pagePixels(b)];
      return Math.max(Math.abs(p[0] - q[0]), Math.abs(p[1] - q[1])) < GRIP_PX;
    },
    millimetres(c, r) {
      const m = this.toMillimetres;
      if (!m || m.length !== 9) return null;
      const w = m[6] * c + m[7] * r + m[8];
      return w > 0 ? [(m[0] * c + m[1] * r + m[2]) / w, (m[3] * c + m[4] * r + m[5]) / w] : null;
    },
    temperature(c, r) {
      [c, r] = [Math.round(c), Math.round(r)];
      const inside = c >= 0 && c < this.columns && r >= 0 && r < this.rows && this.pixels;
      return inside ? this.pixels[r * this.columns + c] : undefined;
    },
    readValue() {
      if (!this.cursor) return;
      const [c, r] = this.cursor, T = this.temperature(c, r);
      const bad = this.mask?.[Math.round(r) * this.columns + Math.round(c)];
      this.value = T === undefined ? "outside" : !Number.isFinite(T)
        ? bad === 1 ? "dead in every frame" : this.missingWords
        : `${T.toFixed(2)} ${this.unit}` + (bad ? ", bad pixel" : "");
    },

    // --- pointer ----------------------------------------------------------------------------------------------------
    press(event) {
      this.$refs.canvas.setPointerCapture(event.pointerId);
      const at = this.place(event);
      if (this.compact || event.button > 1) return;
      if (this.tool === "pan" || event.shiftKey || event.button === 1) {
        this.drag = { kind: "pan", from: [event.clientX, event.clientY], left: this.left, top: this.top };
      } else if (this.tool === "mark") {
        const grip = (this.marks ?? []).find((m) => this.near([m.column, m.row], at));
        this.drag = { kind: "mark", name: grip?.name ?? this.nextMark };
        if (!grip) this.sendMark(at);
      } else this.pressMeasured(at);
      event.preventDefault();
      this.$refs.canvas.focus({ preventScroll: true });
    },
    pressMeasured(at) {
      for (const m of [...(this.measurements ?? [])].reverse()) {
        const corner = m.points.findIndex((p) => this.near(p, at));
        if (corner < 0 && !this.covers(m, at)) continue;
        this.drag = { kind: m.kind, id: m.id, corner, from: at, points: m.points.map((p) => [...p]) };
        this.selected = m.id;
        return;
      }
      this.selected = null;
      const points = this.tool === "spot" ? [at] : [at, at];
      this.drag = { kind: this.tool, id: null, corner: points.length - 1, from: at, points };
      this.draft = { kind: this.tool, id: null, name: "", points };
      this.paint();
    },
    placeMeasured() {  // by the keyboard: in the middle of what is shown; the table takes other coordinates
      const wide = this.columns / this.zoom, high = this.rows / this.zoom;
      const points = KEYED[this.tool].map(([x, y]) => [this.left + x * wide - 0.5, this.top + y * high - 0.5]);
      this.$emit("measure", { id: null, kind: this.tool, points });
    },
    covers(m, at) {
      if (m.kind === "spot") return false;
      const [a, b] = m.points;
      if (m.kind === "box") return [0, 1].every((k) => at[k] >= Math.min(a[k], b[k]) && at[k] <= Math.max(a[k], b[k]));
      const d = [b[0] - a[0], b[1] - a[1]], length = Math.hypot(...d) || 1;
      const along = ((at[0] - a[0]) * d[0] + (at[1] - a[1]) * d[1]) / length;
      const foot = [a[0] + (d[0] * along) / length, a[1] + (d[1] * along) / length];
      return along > 0 && along < length && this.near(foot, at);
    },
    move(event) {
      const at = this.place(event);
      this.cursor = at; this.readValue(); this.tell("followCursor", at);
      if (this.drag?.kind === "pan") {
        const box = this.$refs.canvas.getBoundingClientRect(), size = this.columns / this.zoom / box.width;
        this.setView(this.zoom, this.drag.left - (event.clientX - this.drag.from[0]) * size,
                     this.drag.top - (event.clientY - this.drag.from[1]) * size);
      } else if (this.drag?.kind === "mark") this.sendMark(at);
      else if (this.drag) this.moveMeasured(at);
      this.paint();
      if (this.tool === "mark") this.magnify(at);
    },
    moveMeasured(at) {
      const d = this.drag, limit = (p) => [clamp(p[0], 0, this.columns - 1), clamp(p[1], 0, this.rows - 1)];
      const points = d.points.map((p, k) => limit(d.corner === k ? at : d.corner >= 0 ? p
        : [p[0] + at[0] - d.from[0], p[1] + at[1] - d.from[1]]));
      const name = (this.measurements ?? []).find((m) => m.id === d.id)?.name ?? "";
      this.draft = { kind: d.kind, id: d.id, name, points };
    },
    release(event) {
      const d = this.drag, at = this.place(event);
      this.drag = null;
      if (d?.kind === "mark") this.sendMark(at, d.name, true);
      else if (d && d.kind !== "pan") {
        const points = this.draft?.points ?? d.points;
        const far = points.length < 2 || Math.hypot(points[0][0] - points[1][0], points[0][1] - points[1][1]) >= 1;
        if (far) this.$emit("measure", { id: d.id, kind: d.kind, points });
        else { this.draft = null; this.paint(); }
      }
    },
    leave() {
      this.cursor = null; this.tell("followCursor", null); this.paint(); this.magnify();
    },
    sendMark(at, name = this.drag.name, done = false) {
      const mark = { name, column: at[0], row: at[1], done };
      this.shownMark = mark;
      if (done) { this.sent.mark = 0; clearTimeout(this.sent.markTimer); this.$emit("mark", mark); }
      else this.throttle("mark", DRAG_MS, mark);
      this.magnified = name;
    },
    throttle(name, interval, value) {
      clearTimeout(this.sent[name + "Timer"]);
      const wait = (this.sent[name] ?? 0) + interval - performance.now();
      const send = () => { this.sent[name] = performance.now(); this.$emit(name, value); };
      if (wait <= 0) send(); else this.sent[name + "Timer"] = setTimeout(send, wait);
    },
    turnWheel(event) {
      if (this.zoom === 1 && event.deltaY > 0) return;  // the page scrolls on
      event.preventDefault();
      this.zoomBy(event.deltaY < 0 ? 1.25 : 0.8, this.place(event));
    },
    zoomBy(factor, at = [this.left + this.columns / this.zoom / 2 - 0.5, this.top + this.rows / this.zoom / 2 - 0.5]) {
      const zoom = clamp(this.zoom * factor, 1, MAX_ZOOM), keep = this.zoom / zoom;
      this.setView(zoom, at[0] + 0.5 - (at[0] + 0.5 - this.left) * keep, at[1] + 0.5 - (at[1] + 0.5 - this.top) * keep);
    },
    setView(zoom, left, top) {
      this.zoom = zoom;
      this.left = clamp(left, 0, this.columns * (1 - 1 / zoom));
      this.top = clamp(top, 0, this.rows * (1 - 1 / zoom));
      this.share();
    },
    fit() { this.setView(1, 0, 0); },
    pressKey(event) {
      const steps = { ArrowLeft: -1, ArrowRight: 1, PageDown: 10, PageUp: -10 }, slider = event.target.type === "range";
      if (["INPUT", "TEXTAREA"].includes(event.target.tagName) && !slider) return;
      if (event.target.closest(".q-select, button") && event.key === " ") return;
      if (event.key in steps && !event.target.closest(".q-select"))
        this.go((this.target?.[0] ?? this.frame) + steps[event.key]);
      else if (event.key === "Home") this.go(0);
      else if (event.key === "End") this.go(this.count - 1);
      else if (event.key === " ") this.toggle();
      else if (event.key === "+") this.zoomBy(2);
      else if (event.key === "-") this.zoomBy(0.5);
      else if (event.key === "0") this.fit();
      else if (event.key === "Enter" && event.target === this.$refs.canvas && this.tool in KEYED) this.placeMeasured();
      else if (event.key === "Delete" && this.selected) this.$emit("measure", { id: this.selected, kind: "", points: [] });
      else return;
      event.preventDefault();
    },

    // --- drawing ----------------------------------------------------------------------------------------------------
    paint() {
      if (this.waiting) return;
      this.waiting = requestAnimationFrame(() => { this.waiting = 0; this.paintNow(); });
    },
    paintNow() {
      const canvas = this.$refs.canvas;
      if (!canvas || !this.pixels) return;
      const dots = window.devicePixelRatio || 1, wide = canvas.clientWidth, high = canvas.clientHeight;
      if (canvas.width !== Math.round(wide * dots)) canvas.width = Math.round(wide * dots);
      if (canvas.height !== Math.round(high * dots)) canvas.height = Math.round(high * dots);
      const g = canvas.getContext("2d");
      g.setTransform(1, 0, 0, 1, 0, 0);
      g.imageSmoothingEnabled = false;
      g.drawImage(this.buffer, this.left, this.top, this.columns / this.zoom, this.rows / this.zoom, 0, 0, canvas.width,
                  canvas.height);
      g.setTransform(dots, 0, 0, dots, 0, 0);
      if (this.outline?.length) this.trace(g, this.outline, true, "#FFFFFF", [8, 5]);
      for (const m of this.marks ?? []) {
        const at = this.drag?.name === m.name && this.shownMark ? [this.shownMark.column, this.shownMark.row] : [m.column, m.row];
        this.ring(g, at, m.colour);
      }
      const all = (this.measurements ?? []).filter((m) => m.id !== this.draft?.id);
      for (const m of this.draft ? [...all, this.draft] : all) this.paintMeasured(g, m);
      if (this.cursor) this.cross(g, this.pagePixels(this.cursor), wide, high);
    },
    trace(g, points, closed, colour, dash = []) {
      for (const [width, tint, line] of [[4, "rgba(0, 0, 0, 0.55)", []], [2, colour, dash]]) {
        g.beginPath();
        points.map((p) => this.pagePixels(p)).forEach(([x, y], k) => (k ? g.lineTo(x, y) : g.moveTo(x, y)));
        if (closed) g.closePath();
        Object.assign(g, { lineWidth: width, strokeStyle: tint });
        if (!dash.length || width === 2) { g.setLineDash(line); g.stroke(); }
      }
      g.setLineDash([]);
    },
    ring(g, at, colour) {
      const [x, y] = this.pagePixels(at);
      for (const [width, tint] of [[4, "rgba(0, 0, 0, 0.55)"], [2, colour]]) {
        g.beginPath(); g.arc(x, y, GRIP_PX / 2, 0, 2 * Math.PI);
        Object.assign(g, { lineWidth: width, strokeStyle: tint }); g.stroke();
      }
      g.fillStyle = colour; g.fillRect(x - 1, y - 1, 2, 2);
    },
    paintMeasured(g, m) {
      const [a, b] = m.points;
      if (m.kind === "spot") {
        this.ring(g, a, MEASURED);
      } else if (m.kind === "box") {
        this.trace(g, [a, [b[0], a[1]], b, [a[0], b[1]]], true, MEASURED);
        const ends = this.extremes(a, b);
        if (ends) this.paintExtremes(g, ends);
      }
      else { this.trace(g, [a, b], false, MEASURED); for (const p of [a, b]) this.ring(g, p, MEASURED); }
      const T = m.kind === "spot" ? this.temperature(...a) : m.kind === "box" ? this.extremes(a, b)?.high.T : NaN;
      const value = Number.isFinite(T) ? `${m.kind === "box" ? "max " : ""}${T.toFixed(1)} ${this.unit}` : "";
      const text = [m.name, value].filter(Boolean).join(" ");
      if (!text) return;
      const [x, y] = this.pagePixels(m.kind === "box" ? [Math.min(a[0], b[0]), Math.min(a[1], b[1])] : a);
      g.font = "600 12px system-ui, sans-serif";
      const wide = g.measureText(text).width, put = [clamp(x + 8, 2, g.canvas.clientWidth - wide - 8), Math.max(16, y - 8)];
      g.fillStyle = "rgba(0, 0, 0, 0.65)"; g.fillRect(put[0] - 4, put[1] - 13, wide + 8, 18);
      g.fillStyle = MEASURED; g.fillText(text, ...put);
    },
    extremes(a, b) {  // the hottest and the coldest pixel of a box in this frame
      const side = (k, count) => [a[k], b[k]].map((p) => clamp(Math.round(p), 0, count - 1)).sort((p, q) => p - q);
      const [c0, c1] = side(0, this.columns), [r0, r1] = side(1, this.rows);
      let low = null, high = null;
      for (let r = r0; r <= r1; r++) for (let c = c0; c <= c1; c++) {
        const T = this.pixels[r * this.columns + c];
        if (T !== T) continue;
        if (!high || T > high.T) high = { T, at: [c, r] };
        if (!low || T < low.T) low = { T, at: [c, r] };
      }
      return high && { low, high };
    },
    paintExtremes(g, { low, high }) {  // a triangle upwards at the hottest, downwards at the coldest pixel
      for (const [end, up, colour] of [[high, -1, "#FF5252"], [low, 1, "#40C4FF"]]) {
        const [x, y] = this.pagePixels(end.at);
        g.beginPath(); g.moveTo(x, y + 6 * up); g.lineTo(x - 5, y - 4 * up); g.lineTo(x + 5, y - 4 * up); g.closePath();
        Object.assign(g, { fillStyle: colour, strokeStyle: "rgba(0, 0, 0, 0.7)", lineWidth: 1.5 }); g.stroke(); g.fill();
      }
    },
    pressScale(event) {  // the nearer end of the range follows the pointer
      const box = event.currentTarget.getBoundingClientRect(), share = 1 - (event.clientY - box.top) / box.height;
      event.currentTarget.setPointerCapture(event.pointerId);
      this.scaleEnd = { end: share > 0.5 ? "high" : "low", from: event.clientY, value: share > 0.5 ? this.high : this.low,
                        perPixel: (this.high - this.low) / box.height };
    },
    dragScale(event) {
      const d = this.scaleEnd;
      if (d) this.typeRange(d.end, d.value + (d.from - event.clientY) * d.perPixel);
    },
    cross(g, [x, y], wide, high) {
      for (const [width, tint] of [[3, "rgba(0, 0, 0, 0.4)"], [1, "rgba(255, 255, 255, 0.9)"]]) {
        g.beginPath();
        for (const [x1, y1, x2, y2] of [[0, y, x - 8, y], [x + 8, y, wide, y], [x, 0, x, y - 8], [x, y + 8, x, high]]) {
          g.moveTo(x1, y1); g.lineTo(x2, y2);
        }
        Object.assign(g, { lineWidth: width, strokeStyle: tint }); g.stroke();
      }
    },
    pictureCanvas() {  // the image with its colour scale, rulers, and a line that says what it is
      this.cursor = null; this.paintNow();
      const image = this.$refs.canvas, dots = window.devicePixelRatio || 1, [wide, high] = [image.clientWidth, image.clientHeight];
      const left = this.rulers.length ? 56 : 12, below = this.rulers.length ? 44 : 8, top = 34, right = 92;
      const out = document.createElement("canvas"), g = out.getContext("2d");
      [out.width, out.height] = [Math.round((left + wide + right) * dots), Math.round((top + high + below) * dots)];
      g.scale(dots, dots);
      const write = (text, x, y, align = "left") => { g.textAlign = align; g.fillText(text, x, y); };
      g.fillStyle = "#FFFFFF"; g.fillRect(0, 0, out.width, out.height);
      g.drawImage(image, left, top, wide, high);
      Object.assign(g, { fillStyle: "#000000", strokeStyle: "#000000", font: "13px system-ui, sans-serif", textBaseline: "middle" });
      write([this.fileLabel, this.when].filter(Boolean).join(" · "), left, 17);
      const [x, least] = [left + wide + 14, Math.max(high, 60)], gradient = g.createLinearGradient(0, top + least, 0, top);
      const colours = this.palettes[this.palette];
      colours.forEach((c, k) => gradient.addColorStop(k / (colours.length - 1), c));
      g.fillStyle = gradient; g.fillRect(x, top, 16, least); g.strokeRect(x, top, 16, least); g.fillStyle = "#000000";
      for (const t of this.ticks) write(t.text, x + 22, top + least * (1 - t.at / 100));
      write(this.unit, x, 17);
      const [across = [], up = []] = this.rulers;
      for (const t of across) write(t.text, left + (t.at / 100) * wide, top + high + 12, "center");
      for (const t of up) write(t.text, left - 6, top + (t.at / 100) * high, "right");
      if (across.length) write(`${this.axes[0]}, mm`, left + wide / 2, top + high + 32, "center");
      if (up.length) { g.translate(12, top + high / 2); g.rotate(-Math.PI / 2); write(`${this.axes[1]}, mm`, 0, 0, "center"); }
      return out;
    },
    savePicture() { this.pictureCanvas().toBlob((blob) => this.offer(blob, "png")); },
    saveTable() {  // rows from the top, as camera programs export them; no value where there is none
      const rows = [...Array(this.rows)].map((_, r) =>
        Array.from(this.pixels.subarray(r * this.columns, (r + 1) * this.columns), (T) => (T === T ? T.toFixed(3) : "")).join(","));
      this.offer(new Blob([rows.join("\n") + "\n"], { type: "text/csv" }), "csv");
    },
    offer(blob, kind) {
      const link = document.createElement("a");
      link.href = URL.createObjectURL(blob); link.download = `frame_${this.frame}.${kind}`; link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 1000);
    },

    // --- magnifier --------------------------------------------------------------------------------------------------
    magnifiedMark() {
      const marks = this.marks ?? [];
      return marks.find((m) => m.name === this.magnified) ?? marks[marks.length - 1];
    },
    joinMagnifier() {
      const canvas = this.magnifierId && document.getElementById(this.magnifierId);
      if (!canvas) return;
      this.magnifier = canvas;
      canvas.addEventListener("pointerdown", (event) => {
        const mark = this.magnifiedMark();
        if (!mark || !this.middle) return;
        const box = canvas.getBoundingClientRect();
        const at = [event.clientX - box.left, event.clientY - box.top].map((d, k) =>
          this.middle[k] + (d / box.width - 0.5) * MAGNIFIED_PX);
        this.sendMark(at, mark.name, true);
        this.shownMark = null;
      });
    },
    magnify(at = null) {
      if (!this.magnifier) this.joinMagnifier();
      const canvas = this.magnifier, mark = this.magnifiedMark();
      if (!canvas || !this.pixels) return;
      canvas.dataset.empty = !at && !mark;
      if (!at && !mark) return;
      at = at ?? [mark.column, mark.row];
      const side = MAGNIFIED_PX, size = 18, [c, r] = (this.middle = at.map(Math.round));
      [canvas.width, canvas.height] = [side * size, side * size];
      const g = canvas.getContext("2d");
      Object.assign(g, { imageSmoothingEnabled: false, fillStyle: "#808080" });
      g.fillRect(0, 0, side * size, side * size);
      const half = (side - 1) / 2;
      g.drawImage(this.buffer, c - half, r - half, side, side, 0, 0, side * size, side * size);
      const [x, y] = [(at[0] - c + half + 0.5) * size, (at[1] - r + half + 0.5) * size];
      g.beginPath(); g.moveTo(x, 0); g.lineTo(x, side * size); g.moveTo(0, y); g.lineTo(side * size, y);
      g.strokeStyle = mark?.colour ?? "#FFFFFF"; g.stroke();
    },
  },
};
