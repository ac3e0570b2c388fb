// Below each table: copy as tab-separated text, save as CSV. Without scripts a table stands without them.
"use strict";
for (const table of document.querySelectorAll(".wide > table")) {
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
