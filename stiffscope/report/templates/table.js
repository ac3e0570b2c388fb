// Below each table: copy as tab-separated text, save as CSV. Tables of many rows are sorted by a click on a column's name.
// Without scripts a table stands without them.
"use strict";
const SORTED_FROM = 8;  // rows
const number = (text) => parseFloat(text.replace("−", "-").replace(/,(?=\d{3})/g, ""));
function sort(table, k) {
  const head = table.tHead.rows[0].cells[k], up = head.ariaSort !== "ascending", body = table.tBodies[0];
  const keys = new Map([...body.rows].map((row) => [row, row.cells[k].textContent]));
  const plain = [...keys.values()].some((text) => text && Number.isNaN(number(text)));
  const compare = (a, b) => (plain ? a.localeCompare(b) : (number(a) || 0) - (number(b) || 0));
  body.append(...[...body.rows].sort((a, b) => (up ? 1 : -1) * compare(keys.get(a), keys.get(b))));
  for (const cell of table.tHead.rows[0].cells) cell.removeAttribute("aria-sort");
  head.ariaSort = up ? "ascending" : "descending";
}
for (const table of document.querySelectorAll(".wide > table")) {
  if (table.tBodies[0].rows.length >= SORTED_FROM) [...table.tHead.rows[0].cells].forEach((cell, k) => {
    if (!cell.textContent) return;
    const button = Object.assign(document.createElement("button"), { type: "button", textContent: cell.textContent, onclick: () => sort(table, k) });
    button.title = "Sort";
    cell.replaceChildren(button);
  });
  const title = table.caption.textContent.trim() || "table";
  const cells = () => [...table.rows].map((row) => [...row.cells].map((cell) => cell.textContent.trim()));
  const quoted = (text) => (/[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);
  const tools = document.createElement("p");
  tools.className = "tools";
  const add = (words, act) => {
    const button = document.createElement("button");
    Object.assign(button, { type: "button", textContent: words, onclick: () => act(button) });
    button.setAttribute("aria-label", `${words}: ${title}`);
    tools.append(button);
  };
  const say = (button, words) => { const before = button.textContent; button.textContent = words; setTimeout(() => { button.textContent = before; }, 1500); };
  add("Copy", (button) => navigator.clipboard.writeText(cells().map((row) => row.join("\t")).join("\n"))
    .then(() => say(button, "Copied"), () => { getSelection().selectAllChildren(table); say(button, "Selected: Ctrl-C"); }));
  add("Save CSV", () => {
    const text = cells().map((row) => row.map(quoted).join(",")).join("\r\n") + "\r\n";
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob(["\ufeff", text], { type: "text/csv" }));
    link.download = `${title.replace(/[^\p{L}\p{N}]+/gu, "-").slice(0, 60)}.csv`;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  });
  table.parentElement.after(tools);
}
