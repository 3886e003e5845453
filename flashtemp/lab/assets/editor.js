// Tells an element of the page, as an event "scheme", whether the page is dark: now and whenever that changes.
function watchScheme(id) {
  const tell = () => {
    const dark = document.body.classList.contains("body--dark");
    getHtmlElement(id)?.dispatchEvent(new CustomEvent("scheme", { detail: dark }));
  };
  new MutationObserver(tell).observe(document.body, { attributes: true, attributeFilter: ["class"] });
  tell();
}

// Gives the text area of an editor its name for screen readers.
function nameEditor(id, name) {
  getHtmlElement(id)?.querySelector(".cm-content")?.setAttribute("aria-label", name);
}
