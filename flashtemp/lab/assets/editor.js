// Colours an editor for light or dark, now and whenever that changes, and gives its text a name for screen readers.
// It is done here: an update by the server would replace what was typed since with the text that the server knows.
async function prepareEditor(id, name) {
  const editor = getElement(id);
  await editor.editorPromise;
  const colour = () =>
    editor.setTheme(document.body.classList.contains("body--dark") ? "vscodeDark" : "vscodeLight");
  new MutationObserver(colour).observe(document.body, { attributes: true, attributeFilter: ["class"] });
  colour();
  const text = getHtmlElement(id).querySelector(".cm-content");
  text.setAttribute("aria-label", name);
  text.tabIndex = 0;
}

// Whether the browser asks before it leaves the page, because changes of its text would be lost.
function askBeforeLeaving(asks) {
  window.onbeforeunload = asks ? (event) => event.preventDefault() : null;
}

// Marks the lines of an editor that have errors, a JSON object {line: error}; the errors are shown under the pointer.
async function markLines(id, lines) {
  const editor = getElement(id);
  await editor.editorPromise;
  const errors = JSON.parse(lines);
  const inside = Object.keys(errors).map(Number).filter((line) => line <= editor.editor.state.doc.lines);
  editor.setDecorations(inside.map((line) => ({ kind: "line", line, class: "ft-fault-line" })));
  editor.setLineTooltips(Object.fromEntries(inside.map((line) => [line, errors[line]])));
}
