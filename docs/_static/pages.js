// What screen readers and keyboards need and the theme lacks: levels of headings, names of landmarks, code that scrolls.
document.addEventListener("DOMContentLoaded", () => {
  const set = (where, attributes) => document.querySelectorAll(where).forEach((element) =>
    Object.entries(attributes).forEach(([name, value]) => element.setAttribute(name, value)));
  set(".caption[role=heading]", { "aria-level": 2 });
  set(".sidebar-drawer", { "aria-label": "All pages" });
  set(".toc-drawer", { "aria-label": "On this page" });
  set(".content-icon-container", { role: "navigation", "aria-label": "Source and colours of this page" });
  set("pre, .table-wrapper, .math-wrapper", { tabindex: 0 });
});
