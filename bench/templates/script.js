(function () {
  'use strict';
  var root = document.documentElement;
  root.classList.add('scripted');
  function all(selector, within) { return Array.from((within || document).querySelectorAll(selector)); }
  function one(selector, within) { return (within || document).querySelector(selector); }

  // Theme: the system's until someone chooses.
  one('#theme').addEventListener('click', function () {
    var dark = root.dataset.theme ? root.dataset.theme === 'dark' : matchMedia('(prefers-color-scheme: dark)').matches;
    root.dataset.theme = dark ? 'light' : 'dark';
  });

  // A number of a cell; what has none goes last in either direction.
  function number(element) {
    var text = element && element.dataset.value;
    if (text === undefined || text === null) { return null; }
    var value = text === 'inf' ? Infinity : text === '-inf' ? -Infinity : parseFloat(text);
    return isNaN(value) ? null : value;
  }
  function byValue(a, b, down) {
    if (a === null || b === null) { return a === b ? 0 : a === null ? 1 : -1; }
    return a === b ? 0 : (a < b) === down ? 1 : -1;
  }

  // Tables.
  all('table.scores').forEach(function (table) {
    var heads = all('thead tr:last-child th', table);
    var body = one('tbody', table);
    heads.forEach(function (head, column) {
      head.tabIndex = 0;
      function sort() {
        var down = head.getAttribute('aria-sort') === 'ascending';
        heads.forEach(function (h) { h.removeAttribute('aria-sort'); });
        head.setAttribute('aria-sort', down ? 'descending' : 'ascending');
        all('tr', body).sort(function (a, b) {
          if (head.dataset.sort === 'text') {
            var order = a.children[column].textContent.localeCompare(b.children[column].textContent, 'en', { numeric: true });
            return down ? -order : order;
          }
          return byValue(number(a.children[column]), number(b.children[column]), down);
        }).forEach(function (row) { body.appendChild(row); });
      }
      head.addEventListener('click', sort);
      head.addEventListener('keydown', function (event) {
        if (event.key === 'Enter' || event.key === ' ') { event.preventDefault(); sort(); }
      });
    });
  });

  // Pairs: filters and order.
  var cards = one('#cards');
  if (!cards) { return; }
  var pairs = all('.pair', cards);
  function shownMethods() {
    return all('#controls input[name=method]').filter(function (box) { return box.checked; }).map(function (box) { return box.value; });
  }
  function score(pair, metric, methods) {
    var values = all('.method', pair).filter(function (column) { return methods.indexOf(column.dataset.method) >= 0; })
      .map(function (column) { return number(one('dd[data-metric="' + metric + '"]', column)); })
      .filter(function (value) { return value !== null; });
    if (!values.length) { return null; }
    return values.reduce(function (a, b) { return a + b; }, 0) / values.length;
  }
  function arrange() {
    var dataset = one('#f-dataset').value, methods = shownMethods(), of = one('#f-of').value;
    var sort = one('#f-sort').value.split(':');
    var visible = 0;
    pairs.forEach(function (pair) {
      pair.hidden = dataset !== '' && pair.dataset.dataset !== dataset;
      if (!pair.hidden) { visible += 1; }
      all('.method', pair).forEach(function (column) { column.hidden = methods.indexOf(column.dataset.method) < 0; });
    });
    one('#none').hidden = visible > 0;
    function key(pair) {
      if (sort[0] === 'order') { return +pair.dataset.order; }
      if (sort[1] === 'baseline' || sort[1] === 'overlap') {
        var text = pair.dataset[sort[1]];
        return text === undefined ? null : +text;
      }
      return score(pair, sort[1], of === '' ? methods : [of]);
    }
    pairs.map(function (pair) { return [key(pair), pair]; })
      .sort(function (a, b) { return byValue(a[0], b[0], sort[0] === 'down') || a[1].dataset.order - b[1].dataset.order; })
      .forEach(function (entry) { cards.appendChild(entry[1]); });
  }
  one('#controls').addEventListener('change', arrange);

  // A prediction shows the target while pointed at or focused.
  function source(pair, kind, method) {
    var within = method === undefined ? one('.views', pair) : one('.method[data-method="' + method + '"]', pair);
    return within && one('figure[data-kind=' + kind + '] img', within);
  }
  all('figure[data-kind=prediction]', cards).forEach(function (figure) {
    var image = one('img', figure), caption = one('figcaption', figure);
    var target = source(figure.closest('.pair'), 'target');
    if (!image || !target) { return; }
    var own = image.src;
    image.dataset.own = own;
    function flip(on) {
      image.src = on ? target.src : own;
      caption.textContent = on ? 'Target' : 'Prediction';
      figure.classList.toggle('flipped', on);
    }
    figure.addEventListener('pointerenter', function () { flip(true); });
    figure.addEventListener('pointerleave', function () { flip(false); });
    image.parentNode.addEventListener('keydown', function (event) {
      if (event.key === ' ' || event.key === 'f') { event.preventDefault(); flip(!figure.classList.contains('flipped')); }
    });
    image.parentNode.addEventListener('blur', function () { flip(false); });
  });

  // The large view.
  var viewer = one('#viewer'), stage = one('.stage', viewer), under = one('#v-under'), over = one('#v-over'), bar = one('#v-bar');
  var now = { pair: null, method: null, view: 'prediction', split: 0.5 };
  function columns() { return all('.method', now.pair).filter(function (column) { return !column.hidden; }); }
  function address(kind) {
    var image = kind === 'source' || kind === 'target' ? source(now.pair, kind) : source(now.pair, kind, now.method);
    return image ? image.dataset.own || image.src : null;
  }
  // Where a contained picture begins and ends in the stage.
  function span() {
    var box = stage.getBoundingClientRect(), ratio = under.naturalWidth / under.naturalHeight || 1;
    var width = Math.min(box.width, box.height * ratio);
    return { left: (box.width - width) / 2, width: width };
  }
  function split() {
    var compare = now.view === 'compare', at = span();
    var x = at.left + now.split * at.width;
    over.style.clipPath = compare ? 'inset(0 0 0 ' + x + 'px)' : '';
    bar.hidden = !compare;
    bar.style.left = x + 'px';
    bar.style.display = compare ? '' : 'none';
    stage.style.cursor = compare ? 'ew-resize' : '';
  }
  function show() {
    var method = one('.method[data-method="' + now.method + '"]', now.pair);
    var label = method ? one('h4', method).textContent : '';
    one('#v-title').textContent = one('h3', now.pair).textContent;
    one('#v-sub').textContent = all('header li', now.pair).map(function (li) { return li.textContent; }).join(' · ');
    one('#v-scores').textContent = method ? label + ': ' + all('dl div', method).map(function (div) {
      return one('dt', div).textContent + ' ' + one('dd', div).textContent;
    }).join(' · ') : '';
    all('[data-view]', viewer).forEach(function (button) {
      var kind = button.dataset.view === 'compare' ? 'prediction' : button.dataset.view;
      button.disabled = !address(kind);
      button.setAttribute('aria-pressed', button.dataset.view === now.view);
    });
    var list = one('#v-methods');
    list.textContent = '';
    columns().forEach(function (column) {
      var button = document.createElement('button');
      button.type = 'button';
      button.textContent = one('h4', column).textContent;
      button.setAttribute('aria-pressed', column.dataset.method === now.method);
      button.addEventListener('click', function () { now.method = column.dataset.method; show(); });
      list.appendChild(button);
    });
    var compare = now.view === 'compare';
    var kind = compare ? 'prediction' : now.view;
    var top = address(kind);
    var words = { source: 'Source', target: 'Target', prediction: 'Prediction · ' + label, error: 'Error · ' + label, compare: 'Target | Prediction · ' + label };
    one('#v-what').textContent = top ? words[now.view] : 'no picture';
    over.style.display = top ? '' : 'none';
    if (top) { over.src = top; over.alt = words[kind]; }
    under.style.visibility = compare ? 'visible' : 'hidden';
    under.src = address('target') || top || '';
    under.onload = split;
    split();
  }
  function open(button) {
    var figure = button.closest('figure'), column = button.closest('.method');
    now.pair = button.closest('.pair');
    now.view = figure.dataset.kind;
    var visible = columns();
    now.method = column ? column.dataset.method : visible.some(function (c) { return c.dataset.method === now.method; }) ? now.method : visible.length ? visible[0].dataset.method : null;
    viewer.showModal();
    show();
  }
  function step(list, item, by) {
    var at = list.indexOf(item);
    return list[(at + by + list.length) % list.length];
  }
  all('.pic', cards).forEach(function (button) { button.addEventListener('click', function () { open(button); }); });
  one('#v-close').addEventListener('click', function () { viewer.close(); });
  all('[data-view]', viewer).forEach(function (button) {
    button.addEventListener('click', function () { now.view = button.dataset.view; show(); });
  });
  stage.addEventListener('pointermove', function (event) {
    if (now.view !== 'compare') { return; }
    var at = span();
    now.split = Math.min(1, Math.max(0, (event.clientX - stage.getBoundingClientRect().left - at.left) / at.width));
    split();
  });
  window.addEventListener('resize', function () { if (viewer.open) { split(); } });
  viewer.addEventListener('keydown', function (event) {
    var views = { '1': 'source', '2': 'target', '3': 'prediction', '4': 'error', '5': 'compare' };
    var visible = all('.pair', cards).filter(function (pair) { return !pair.hidden; });
    if (views[event.key]) { now.view = views[event.key]; }
    else if (event.key === ' ') { now.view = now.view === 'target' ? 'prediction' : 'target'; }
    else if (event.key === 'ArrowRight') { now.pair = step(visible, now.pair, 1); }
    else if (event.key === 'ArrowLeft') { now.pair = step(visible, now.pair, -1); }
    else if (event.key === 'ArrowDown' || event.key === 'ArrowUp') {
      var list = columns(), current = list.filter(function (c) { return c.dataset.method === now.method; })[0];
      if (list.length) { now.method = step(list, current || list[0], event.key === 'ArrowDown' ? 1 : -1).dataset.method; }
    } else { return; }
    event.preventDefault();
    show();
  });
}());
