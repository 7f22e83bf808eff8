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
  // By how much B is worse than A, where the page compares two runs.
  function lossKey(sort) { return sort[1] && sort[1].indexOf('loss-') === 0 ? sort[1] : ''; }
  function arrange() {
    var dataset = one('#f-dataset').value, methods = shownMethods(), of = one('#f-of').value;
    var sort = one('#f-sort').value.split(':');
    var change = one('#f-change') && one('#f-change').value;
    var visible = 0;
    pairs.forEach(function (pair) {
      var lost = +pair.dataset[lossKey(sort) || 'loss-0'];
      pair.hidden = (dataset !== '' && pair.dataset.dataset !== dataset) ||
        (change === 'worse' && !(lost > 0)) || (change === 'better' && !(lost < 0));
      if (!pair.hidden) { visible += 1; }
      all('.method', pair).forEach(function (column) { column.hidden = methods.indexOf(column.dataset.method) < 0; });
    });
    one('#none').hidden = visible > 0;
    function key(pair) {
      if (sort[0] === 'order') { return +pair.dataset.order; }
      if (lossKey(sort)) { return number({ dataset: { value: pair.dataset[lossKey(sort)] } }); }
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
  if (one('#f-change')) { arrange(); }

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

  // The large view. Its pictures are those that the run kept, where they are in place, else those of the page.
  var viewer = one('#viewer'), stage = one('.stage', viewer), pan = one('#v-pan'), under = one('#v-under'), over = one('#v-over'), bar = one('#v-bar');
  var now = { pair: null, method: null, view: 'prediction', split: 0.5, zoom: 1, x: 0, y: 0 };
  function clamp(value, low, high) { return Math.min(high, Math.max(low, value)); }
  function columns() { return all('.method', now.pair).filter(function (column) { return !column.hidden; }); }
  // The columns of A and B that the current method is one of.
  function sides() {
    var found = all('.method[data-against]', now.pair).filter(function (column) {
      return column.dataset.method === now.method || column.dataset.against === now.method;
    })[0];
    return found ? [found.dataset.against, found.dataset.method] : [];
  }
  function picture(kind) { return kind === 'source' || kind === 'target' ? source(now.pair, kind) : source(now.pair, kind, now.method); }
  function put(element, image) {
    var small = image.dataset.own || image.src, wanted = image.dataset.full || small;
    if (element.dataset.wanted === wanted) { return; }
    element.dataset.wanted = wanted;
    element.onerror = function () { element.onerror = null; element.src = small; };
    element.src = wanted;
  }
  // Where a contained picture begins and ends in the stage, before it is zoomed.
  function span() {
    var box = stage.getBoundingClientRect(), ratio = under.naturalWidth / under.naturalHeight || 1;
    var width = Math.min(box.width, box.height * ratio);
    return { left: (box.width - width) / 2, width: width };
  }
  function split() { return now.view === 'compare' || now.view === 'sides'; }
  function place() {
    var compare = split(), at = span(), box = stage.getBoundingClientRect();
    now.x = clamp(now.x, box.width * (1 - now.zoom), 0);
    now.y = clamp(now.y, box.height * (1 - now.zoom), 0);
    pan.style.transform = 'translate(' + now.x + 'px,' + now.y + 'px) scale(' + now.zoom + ')';
    pan.classList.toggle('near', now.zoom >= 3);
    var x = at.left + now.split * at.width;
    over.style.clipPath = compare ? 'inset(0 0 0 ' + x + 'px)' : '';
    bar.hidden = !compare;
    bar.style.left = now.x + now.zoom * x + 'px';
    bar.setAttribute('aria-valuenow', Math.round(now.split * 100));
    stage.style.cursor = now.zoom > 1 ? 'move' : compare ? 'ew-resize' : '';
  }
  function splitAt(event) {
    var at = span();
    now.split = clamp(((event.clientX - stage.getBoundingClientRect().left - now.x) / now.zoom - at.left) / at.width, 0, 1);
    place();
  }
  // The point under the pointer, or else the middle, stays where it is.
  function zoom(factor, event) {
    var box = stage.getBoundingClientRect(), before = now.zoom;
    var x = event ? event.clientX - box.left : box.width / 2, y = event ? event.clientY - box.top : box.height / 2;
    now.zoom = clamp(before * factor, 1, 32);
    now.x = x - (x - now.x) * now.zoom / before;
    now.y = y - (y - now.y) * now.zoom / before;
    place();
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
      var view = button.dataset.view;
      button.disabled = view === 'sides' ? !sides().length : view === 'change' ? !source(now.pair, 'change', sides()[1]) :
        !picture(view === 'compare' ? 'prediction' : view);
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
    var kind = split() ? 'prediction' : now.view;
    var top = picture(kind), target = picture('target'), both = sides();
    if (now.view === 'sides') { top = source(now.pair, 'prediction', both[1]); target = source(now.pair, 'prediction', both[0]); }
    if (now.view === 'change') { top = source(now.pair, 'change', both[1]); }
    var words = { change: 'Change of the error in B against A', sides: 'A | B', source: 'Source', target: 'Target', prediction: 'Prediction · ' + label, error: 'Error · ' + label, compare: 'Target | Prediction · ' + label };
    one('#v-what').textContent = top ? words[now.view] : 'no picture';
    over.style.display = top ? '' : 'none';
    if (top) { put(over, top); over.alt = words[now.view === 'sides' ? 'sides' : kind]; }
    under.style.visibility = split() ? 'visible' : 'hidden';
    if (target || top) { put(under, target || top); }
    history.replaceState(null, '', '#' + now.pair.id);
    place();
  }
  under.addEventListener('load', place);
  function open(pair, method, view) {
    now.pair = pair;
    now.view = view;
    now.zoom = 1;
    var visible = columns().map(function (column) { return column.dataset.method; });
    now.method = [method, now.method, visible[0]].filter(function (m) { return visible.indexOf(m) >= 0; })[0] || null;
    if (!viewer.open) { viewer.showModal(); }
    show();
  }
  function openFragment() {
    var pair = location.hash.indexOf('#pair=') === 0 && document.getElementById(location.hash.slice(1));
    var ranked = pair && one('.method[data-ranked]', pair);
    if (pair) { open(pair, ranked && ranked.dataset.method, 'prediction'); }
  }
  window.addEventListener('hashchange', openFragment);
  viewer.addEventListener('close', function () { history.replaceState(null, '', '#pairs'); });
  function step(list, item, by) {
    var at = list.indexOf(item);
    return list[(at + by + list.length) % list.length];
  }
  all('.pic', cards).forEach(function (button) {
    button.addEventListener('click', function () {
      var column = button.closest('.method');
      open(button.closest('.pair'), column && column.dataset.method, button.closest('figure').dataset.kind);
    });
  });
  one('#v-close').addEventListener('click', function () { viewer.close(); });
  all('[data-view]', viewer).forEach(function (button) {
    button.addEventListener('click', function () { now.view = button.dataset.view; show(); });
  });
  stage.addEventListener('pointerdown', function (event) {
    event.preventDefault();
    if (event.target === bar) { bar.focus(); }
    bar.classList.toggle('held', event.target === bar);
    stage.setPointerCapture(event.pointerId);
  });
  stage.addEventListener('pointermove', function (event) {
    if (event.buttons && now.zoom > 1 && !bar.classList.contains('held')) {
      now.x += event.movementX;
      now.y += event.movementY;
      place();
    } else if (split()) { splitAt(event); }
  });
  stage.addEventListener('wheel', function (event) { event.preventDefault(); zoom(Math.pow(1.002, -event.deltaY), event); }, { passive: false });
  stage.addEventListener('dblclick', function (event) { zoom(now.zoom > 1 ? 1 / now.zoom : 4, event); });
  bar.addEventListener('keydown', function (event) {
    var by = { ArrowLeft: -0.02, ArrowDown: -0.02, ArrowRight: 0.02, ArrowUp: 0.02, PageDown: -0.1, PageUp: 0.1, Home: -1, End: 1 }[event.key];
    if (by === undefined) { return; }
    event.preventDefault();
    event.stopPropagation();
    now.split = clamp(now.split + by, 0, 1);
    place();
  });
  window.addEventListener('resize', function () { if (viewer.open) { place(); } });
  viewer.addEventListener('keydown', function (event) {
    var views = { '1': 'source', '2': 'target', '3': 'prediction', '4': 'error', '5': 'compare', '6': 'change', '7': 'sides' };
    if (event.ctrlKey || event.metaKey || event.altKey) { return; }
    var zooms = { '+': 1.5, '=': 1.5, '-': 1 / 1.5, '0': 1 / now.zoom };
    var visible = all('.pair', cards).filter(function (pair) { return !pair.hidden; });
    if (views[event.key] && one('[data-view=' + views[event.key] + ']', viewer)) { now.view = views[event.key]; }
    else if (zooms[event.key]) { zoom(zooms[event.key]); }
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
  window.addEventListener('load', openFragment);
}());
