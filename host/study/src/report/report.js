// Draws the designs: a scatter of any two columns, and all columns side by side.
'use strict';
(() => {
  const data = JSON.parse(document.getElementById('data').textContent);
  const { columns, wishes, rows, best, base } = data;
  const SVG = 'http://www.w3.org/2000/svg';
  const make = (parent, name, attributes, text) => {
    const element = document.createElementNS(SVG, name);
    Object.entries(attributes).forEach(([key, value]) => element.setAttribute(key, value));
    if (text !== undefined) element.textContent = text;
    parent.append(element);
    return element;
  };
  const number = (value) => (value === null ? 'none' : String(Number(value.toPrecision(4))));
  const shown = (column, value) => (columns[column].words && value !== null ? columns[column].words[value] : number(value));
  const rangeOf = (column) => {
    const values = [...rows, base].map(([, row]) => row[column]).filter((value) => value !== null);
    const [least, most] = values.reduce(([a, b], value) => [Math.min(a, value), Math.max(b, value)], [Infinity, -Infinity]);
    return most > least ? [least, most] : [least - 0.5, least + 0.5];
  };
  const ranges = columns.map((_, column) => rangeOf(column));
  const told = document.getElementById('told');
  const tell = ([state, row]) => {
    const all = columns.map(({ name }, column) => `${name} ${shown(column, row[column])}`);
    told.textContent = all.concat(state === 0 ? 'limits not met' : []).join(', ');
  };
  const lit = (index, on) => document.querySelectorAll(`[data-row="${index}"]`).forEach((one) => one.classList.toggle('lit', on));
  const hear = (element, index) => {
    element.addEventListener('pointerenter', () => { tell(rows[index] ?? base); lit(index, true); });
    element.addEventListener('pointerleave', () => lit(index, false));
  };

  const cut = (word) => (word.length > 20 ? `${word.slice(0, 19)}\u2026` : word);
  const meets = (a, b) => a.x < b.x + b.width && b.x < a.x + a.width && a.y < b.y + b.height && b.y < a.y + a.height;
  const around = ([x, y], half) => ({ x: x - half, y: y - half, width: 2 * half, height: 2 * half });

  // Moves a text that stands out over a picture's right or left side back into it.
  const inside = (text, right) => {
    const box = text.getBBox();
    const by = Math.max(2 - box.x, 0) - Math.max(box.x + box.width - right + 2, 0);
    text.setAttribute('x', Number(text.getAttribute('x')) + by);
    return text;
  };

  // Takes away what would be written over another text before it.
  const thin = (texts) => texts.reduce((kept, text) => {
    const box = text.getBBox();
    if (kept.some((other) => meets(box, other))) text.remove(); else kept.push(box);
    return kept;
  }, []);

  // Writes beside a mark where there is room among `texts` and `marks`, else among `texts` and `rings`; nowhere if there is none.
  const SIDES = [[9, 3, ''], [-9, 3, 'end'], [0, -9, 'middle'], [0, 16, 'middle'], [8, -7, ''], [-8, -7, 'end'], [8, 14, ''], [-8, 14, 'end']];
  const writeBeside = (svg, [x, y], word, { texts, rings, marks }, [left, top, right, bottom]) => {
    const tried = (others) => SIDES.some(([dx, dy, side]) => {
      const text = make(svg, 'text', { x: x + dx, y: y + dy, class: `mark ${side}` }, word);
      const box = text.getBBox();
      const isIn = box.x >= left && box.y >= top && box.x + box.width <= right && box.y + box.height <= bottom;
      const isFree = isIn && ![...texts, ...others].some((other) => meets(box, other));
      if (isFree) texts.push(box); else text.remove();
      return isFree;
    });
    return tried([...rings, ...marks]) || tried(rings);
  };

  const ticks = ([least, most]) => {
    const rough = (most - least) / 5;
    const power = 10 ** Math.floor(Math.log10(rough));
    const step = [1, 2, 5, 10].map((digit) => digit * power).find((one) => one >= rough * 0.999);
    const all = [];
    for (let k = Math.ceil(least / step - 1e-9); k * step <= most + 1e-9 * step; k += 1) all.push(Number((k * step).toPrecision(9)));
    return all;
  };

  const scatter = (across, up) => {
    const place = document.getElementById('scatter');
    place.replaceChildren();
    const plain = (value) => (Math.abs(value) < 1e6 ? String(value) : value.toExponential().replace('e+', 'e'));
    const word = (column, value) => (columns[column].words ? cut(columns[column].words[value] ?? '') : plain(value));
    const words = (column) => ticks(ranges[column]).map((value) => [value, word(column, value)]);
    // Room for the longest word beside the axis, and for the column's name beside that.
    const [w, h, bottom] = [760, 380, 40];
    const left = Math.max(62, 34 + 6 * Math.max(...words(up).map(([, text]) => text.length)));
    const svg = make(place, 'svg', { viewBox: `0 0 ${w} ${h}`, role: 'img' });
    const scale = (column, from, to) => {
      const [least, most] = ranges[column];
      return (value) => from + ((value - least) / (most - least)) * (to - from);
    };
    const [x, y] = [scale(across, left + 12, w - 14), scale(up, h - bottom - 12, 12)];
    make(svg, 'path', { class: 'axis', d: `M${left} 6V${h - bottom}H${w - 6}` });
    thin(words(across).map(([value, text]) => inside(make(svg, 'text', { x: x(value), y: h - bottom + 14, class: 'middle' }, text), w)));
    thin(words(up).map(([value, text]) => make(svg, 'text', { x: left - 5, y: y(value) + 3, class: 'end' }, text)));
    make(svg, 'text', { x: (left + w) / 2, y: h - 8, class: 'middle' }, columns[across].name);
    make(svg, 'text', { x: 12, y: h / 2, class: 'middle', transform: `rotate(-90 12 ${h / 2})` }, columns[up].name);
    const placeOf = (row) => (row[across] === null || row[up] === null ? null : [x(row[across]), y(row[up])]);
    const taken = { texts: [], rings: [], marks: [] };
    rows.map((row, index) => [row, index]).sort(([a], [b]) => a[0] - b[0]).forEach(([[state, row], index]) => {
      const at = placeOf(row);
      if (at === null) return;
      taken[best.includes(row[0]) ? 'rings' : 'marks'].push(around(at, best.includes(row[0]) ? 6 : 4));
      const own = { 'data-row': index };
      const mark = state === 0
        ? make(svg, 'path', { ...own, class: 'point broken', d: `M${at[0] - 3} ${at[1] - 3}l6 6m0 -6l-6 6` })
        : make(svg, 'circle', { ...own, class: `point${state === 2 ? ' front' : ''}${best.includes(row[0]) ? ' best' : ''}`, cx: at[0], cy: at[1], r: state === 2 ? 5 : 3 });
      hear(mark, index);
    });
    const own = placeOf(base[1]);
    if (own !== null) {
      hear(make(svg, 'path', { class: 'point base', d: `M${own[0]} ${own[1] - 6}l6 6l-6 6l-6 -6z` }), -1);
      taken.rings.push(around(own, 7));
    }
    const write = (at, word) => at !== null && writeBeside(svg, at, word, taken, [left, 2, w - 2, h - bottom]);
    best.forEach((design, rank) => {
      const found = rows.find(([, row]) => row[0] === design);
      if (found) write(placeOf(found[1]), `best ${rank + 1}`);
    });
    write(own, 'unchanged scene');
  };

  const shade = (part) => {
    const colors = [[68, 1, 84], [65, 68, 135], [42, 120, 142], [34, 168, 132], [122, 209, 81], [253, 231, 37]];
    const at = Math.min(Math.max(part, 0), 1) * 5;
    const first = Math.min(Math.floor(at), 4);
    return `rgb(${[0, 1, 2].map((k) => Math.round(colors[first][k] + (colors[first + 1][k] - colors[first][k]) * (at - first))).join(',')})`;
  };

  const parallel = () => {
    const place = document.getElementById('parallel');
    const [w, h, top, bottom] = [Math.max(760, 110 * (columns.length - 1)), 332, 52, 20];
    const svg = make(place, 'svg', { viewBox: `0 0 ${w} ${h}`, role: 'img' });
    const shownColumns = columns.map((_, column) => column).slice(1);
    const x = (k) => 50 + (k * (w - 100)) / Math.max(shownColumns.length - 1, 1);
    const y = (column, value) => {
      const [least, most] = ranges[column];
      return h - bottom - ((value - least) / (most - least)) * (h - top - bottom);
    };
    const [wish] = wishes;
    const part = (row) => {
      const [least, most] = ranges[wish.column];
      const own = (row[wish.column] - least) / (most - least);
      return wish.most ? own : 1 - own;
    };
    // Where none meets the limits, those that do not are better than nothing.
    const least = rows.some(([state]) => state > 0) ? 1 : 0;
    const lines = rows.map(([state, row], index) => [state, row, index])
      .filter(([state, row]) => state >= least && shownColumns.every((column) => row[column] !== null))
      .sort((a, b) => part(a[1]) - part(b[1]))
      .slice(-1500)
      .map(([, row, index]) => {
        const points = shownColumns.map((column, k) => `${x(k).toFixed(1)},${y(column, row[column]).toFixed(1)}`);
        const line = make(svg, 'polyline', { class: 'line', 'data-row': index, points: points.join(' '), stroke: shade(part(row)) });
        hear(line, index);
        return [line, row];
      });
    const kept = new Map();
    const filter = () => lines.forEach(([line, row]) => {
      const isIn = [...kept].every(([column, [from, to]]) => row[column] >= from && row[column] <= to);
      line.classList.toggle('out', !isIn);
    });
    const names = [];
    shownColumns.forEach((column, k) => {
      make(svg, 'path', { class: 'axis', d: `M${x(k)} ${top}V${h - bottom}` });
      // Those at the ends stay within the picture; each is in the first of three lines where it meets no other.
      const side = [[0, ''], [shownColumns.length - 1, 'end']].find(([end]) => end === k)?.[1] ?? 'middle';
      const name = make(svg, 'text', { x: x(k) + { '': -40, end: 40, middle: 0 }[side], class: side }, columns[column].name);
      [26, 14, 38].some((line) => {
        name.setAttribute('y', line);
        return !names.some((other) => meets(name.getBBox(), other));
      });
      const box = name.getBBox();
      names.push({ x: box.x - 4, y: box.y, width: box.width + 8, height: box.height });
      const words = columns[column].words;
      if (words) thin(words.map((word, value) => make(svg, 'text', { x: x(k) + 4, y: y(column, value) + 3 }, cut(word))));
      else ranges[column].forEach((value, end) => make(svg, 'text', { x: x(k), y: end ? top - 3 : h - 6, class: 'middle' }, number(value)));
      const brush = make(svg, 'rect', { class: 'brush', x: x(k) - 8, width: 16, y: 0, height: 0 });
      const handle = make(svg, 'rect', { class: 'handle', x: x(k) - 10, width: 20, y: top, height: h - top - bottom });
      const at = (event) => {
        const box = svg.getBoundingClientRect();
        return Math.min(Math.max(((event.clientY - box.top) * h) / box.height, top), h - bottom);
      };
      let from = null;
      handle.addEventListener('pointerdown', (event) => { from = at(event); handle.setPointerCapture(event.pointerId); });
      handle.addEventListener('pointerup', (event) => {
        if (from === null) return;
        const [high, low] = [Math.min(from, at(event)), Math.max(from, at(event))];
        from = null;
        const value = (pixel) => ranges[column][0] + ((h - bottom - pixel) / (h - top - bottom)) * (ranges[column][1] - ranges[column][0]);
        if (low - high < 4) kept.delete(column); else kept.set(column, [value(low), value(high)]);
        brush.setAttribute('y', high);
        brush.setAttribute('height', kept.has(column) ? low - high : 0);
        filter();
      });
    });
  };

  if (rows.length === 0) return;
  const [across, up] = ['across', 'up'].map((id) => document.getElementById(id));
  columns.forEach(({ name }, column) => [across, up].forEach((list) => list.add(new Option(name, column))));
  across.value = wishes.length > 1 ? wishes[1].column : 0;
  up.value = wishes[0].column;
  const draw = () => scatter(Number(across.value), Number(up.value));
  [across, up].forEach((list) => list.addEventListener('change', draw));
  draw();
  parallel();
})();
