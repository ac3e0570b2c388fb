// Charts of a page, drawn by BokehJS: what x and y are is chosen below, hovering says what a point is, a click finds its row.
"use strict";
Bokeh.logger.set_level("warn");
for (const root of document.querySelectorAll(".chart")) {
  const given = JSON.parse(root.querySelector("script").textContent), one = (name) => root.querySelector(`[data-is=${name}]`);
  const ink = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  // On a dark page series have a contrast of 4.5 (WCAG 2.1; points are drawn at three quarters): dark ones are mixed with its ink.
  const brush = document.createElement("canvas").getContext("2d");
  const read = (colour) => { brush.fillStyle = colour; return [1, 3, 5].map((k) => parseInt(brush.fillStyle.slice(k, k + 2), 16)); };
  const linear = (value) => value <= 10.3 ? value / 3294.6 : ((value / 255 + 0.055) / 1.055) ** 2.4;
  const luminance = (rgb) => rgb.reduce((sum, value, k) => sum + [0.2126, 0.7152, 0.0722][k] * linear(value), 0.05);
  const ground = luminance(read(ink("--ground"))), towards = read(ink("--ink"));
  const visible = (colour) => {
    let rgb = read(colour);
    for (let k = 0; k < 20 && ground < luminance(towards) && luminance(rgb) < 4.5 * ground; k++) rgb = rgb.map((value, n) => Math.round(0.9 * value + 0.1 * towards[n]));
    return `rgb(${rgb.join(",")})`;
  };
  const names = Object.keys(given.series[0].columns);  // the first says which row of a table a point is
  root.classList.add("live");
  const plot = Bokeh.Plotting.figure({ height: 420, sizing_mode: "stretch_width", tools: "pan,box_zoom,wheel_zoom,tap,reset,save",
    background_fill_color: null, border_fill_color: null, outline_line_color: ink("--line"), output_backend: "canvas",
    x_axis_type: given.log ? "log" : "auto" });
  plot.toolbar.logo = null;
  if (given.log) plot.xaxes[0].formatter = new Bokeh.BasicTickFormatter();
  const lines = [], drawn = given.series.map((each) => {
    const source = new Bokeh.ColumnDataSource({ data: each.columns }), at = { x: { field: given.x[0] }, y: { field: given.y[0] }, source, legend_label: each.name };
    const glyph = plot.scatter({ ...at, size: each.size, fill_color: visible(each.colour), line_color: null, fill_alpha: 0.75, nonselection_fill_alpha: 0.35 });
    if (given.joined) lines.push(plot.line({ ...at, line_color: visible(each.colour), line_width: 1.3 }));
    source.selected.properties.indices.change.connect(() => find(source));
    return glyph;
  });
  function find(source) {  // the row of a point, in the table of this page that has it
    const [k] = source.selected.indices, name = k === undefined ? "" : String(source.data[names[0]][k]);
    for (const row of document.querySelectorAll("tr.found")) row.classList.remove("found");
    const head = [...document.querySelectorAll("tbody th")].find((cell) => cell.textContent === name);
    if (!head) return;
    head.closest("details")?.setAttribute("open", "");
    head.parentElement.classList.add("found"); head.scrollIntoView({ block: "nearest" });
  }
  const tips = names.map((name) => [name, `@{${name}}`]);
  plot.add_tools(new Bokeh.HoverTool({ tooltips: tips, renderers: drawn, point_policy: "follow_mouse" }));
  if (given.equal) plot.add_layout(new Bokeh.Slope({ gradient: 1, y_intercept: 0, line_color: ink("--soft"), line_dash: "dashed" }));
  for (const axis of [...plot.xaxes, ...plot.yaxes]) Object.assign(axis, { axis_label_text_font_style: "normal", axis_line_color: ink("--soft"),
    major_label_text_color: ink("--ink"), axis_label_text_color: ink("--ink"), major_tick_line_color: ink("--soft"), minor_tick_line_color: null });
  for (const grid of [...plot.xgrids, ...plot.ygrids]) grid.grid_line_color = ink("--line");
  Object.assign(plot.legend, { location: "top_left", background_fill_alpha: 0, border_line_color: null, label_text_color: ink("--ink"), click_policy: "hide" });
  function choose() {
    for (const [axis, line] of [["x", plot.xaxes[0]], ["y", plot.yaxes[0]]]) {
      const name = one(axis).value;
      for (const glyph of [...drawn, ...lines]) glyph.glyph[axis] = { field: name };
      line.axis_label = name;
    }
    plot.reset.emit();
  }
  for (const axis of ["x", "y"]) {
    one(axis).replaceChildren(...given[axis].map((name) => new Option(name)));
    one(axis).addEventListener("change", choose);
  }
  choose();
  Bokeh.Plotting.show(plot, one("plot"));
}
