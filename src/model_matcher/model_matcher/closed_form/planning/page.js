// The maps of a plan: a part and the places from which a camera sees it, each coloured by what is expected there.
'use strict';
(function () {
  const data = JSON.parse(document.getElementById('data').textContent);
  document.body.dataset.step = '0';
  if (!window.Plotly) return;
  const axis = { visible: false };
  const layout = (title) => ({
    title: { text: title, font: { size: 14 } },
    margin: { l: 0, r: 0, t: 36, b: 0 },
    scene: { aspectmode: 'data', xaxis: axis, yaxis: axis, zaxis: axis },
    showlegend: false,
  });
  const part = {
    type: 'scatter3d', mode: 'lines', hoverinfo: 'skip', line: { color: '#444', width: 3 },
    x: data.part[0], y: data.part[1], z: data.part[2],
  };
  const places = (marker, views = data.views) => ({
    type: 'scatter3d', mode: 'markers', marker: { size: 6, ...marker }, hoverinfo: 'text',
    text: views.map((v) => v.text), x: views.map((v) => v.at[0]), y: views.map((v) => v.at[1]),
    z: views.map((v) => v.at[2]),
  });
  const ticks = (values) => {
    const low = Math.floor(Math.log10(Math.min(...values))), high = Math.ceil(Math.log10(Math.max(...values)));
    const at = [];
    for (let k = low; k <= high; k += 1) for (const m of [1, 2, 5]) at.push(m * 10 ** k);
    return { tickvals: at.map(Math.log10), ticktext: at.map((x) => String(Number(x.toPrecision(1)))) };
  };
  const coloured = (values, unit) => places({
    color: values.map(Math.log10), colorscale: 'Viridis',
    colorbar: { title: { text: unit }, thickness: 12, len: 0.8, ...ticks(values) },
  });
  const draw = (id, traces, title) =>
    window.Plotly.newPlot(id, traces, layout(title), { displayModeBar: false, responsive: true });
  draw('position', [part, coloured(data.views.map((v) => v.mm), 'mm')], 'Position, 95 % of poses');
  draw('rotation', [part, coloured(data.views.map((v) => v.deg), 'deg')], 'Rotation, 95 % of poses');
  if (data.tried.length) {
    draw('tried', [part, places({ color: data.tried.map((v) => v.colour) }, data.tried)],
      'Pictures that were tried');
    const both = data.found;
    const span = (k) => [Math.min(...both.map((p) => p[k])), Math.max(...both.map((p) => p[k]))];
    if (both.length) {
      window.Plotly.newPlot('agreement', [
        { x: both.map((p) => p[0]), y: both.map((p) => p[1]), type: 'scatter', mode: 'markers',
          marker: { size: 5, color: '#2a78b5' }, hoverinfo: 'x+y' },
        { x: span(0), y: span(0), type: 'scatter', mode: 'lines', line: { color: '#999', dash: 'dot' } },
      ], {
        title: { text: 'Position errors of parts found, mm', font: { size: 14 } }, showlegend: false,
        margin: { l: 60, r: 10, t: 36, b: 44 },
        xaxis: { type: 'log', title: { text: 'expected, median' } },
        yaxis: { type: 'log', title: { text: 'rendered' } },
      }, { displayModeBar: false, responsive: true });
    }
  }
}());
