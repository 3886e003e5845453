// A drawing of shapes given as data: no text becomes markup, and only these elements and attributes are drawn.
const TAGS = new Set(["rect", "line", "path", "circle", "polygon", "text", "g"]);
const ATTRIBUTES = new Set(["x", "y", "x1", "y1", "x2", "y2", "cx", "cy", "r", "rx", "width", "height", "d", "points",
  "class", "transform", "text-anchor", "dominant-baseline"]);
export default {
  template: `
    <svg :viewBox="box" role="img" :aria-label="label" class="ft-drawing" preserveAspectRatio="xMidYMid meet">
      <component v-for="(s, k) in safe" :key="k" :is="s.tag" v-bind="s.attributes">{{ s.text }}</component>
    </svg>`,
  props: { shapes: Array, box: String, label: String },
  computed: {
    safe() {
      return (this.shapes || []).filter((s) => TAGS.has(s.tag)).map((s) => ({
        tag: s.tag,
        text: s.text || "",
        attributes: Object.fromEntries(Object.entries(s).filter(([name]) => ATTRIBUTES.has(name))),
      }));
    },
  },
};
