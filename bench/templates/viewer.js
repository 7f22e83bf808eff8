  // The large view. It shows the pictures of run and dataset if they are available, else those of the page.
  var viewer = one('#viewer'), stage = one('.stage', viewer), pan = one('#v-pan'), under = one('#v-under'), over = one('#v-over'), bar = one('#v-bar');
  var now = { pair: null, method: null, view: 'prediction', split: 0.5, zoom: 1, x: 0, y: 0 };
  function clamp(value, low, high) { return Math.min(high, Math.max(low, value)); }
  function isSplit() { return now.view === 'compare' || now.view === 'sides'; }
  // The methods A and B of the comparison that contains the current method.
  function sides() {
    var b = data.methods.map(function (method, at) { return at; }).filter(function (at) {
      var against = data.methods[at].against;
      return against !== null && (at === now.method || against === now.method);
    })[0];
    return b === undefined ? [] : [data.methods[b].against, b];
  }
  // A picture with its address in the run, or the reason why there is none.
  function picture(kind, method) {
    var ofPair = now.pair.pictures[kind];
    var holder = ofPair !== undefined ? now.pair : now.pair.methods[method === undefined ? now.method : method];
    var found = holder && holder.pictures[kind];
    if (!found || typeof found === 'string') { return { absent: found || '' }; }
    return { small: found[0], full: holder === now.pair ? now.pair.full[kind] : kind === 'prediction' ? holder.full : null };
  }
  function put(element, shown) {
    var wanted = shown.full || shown.small;
    if (element.dataset.wanted === wanted) { return; }
    element.dataset.wanted = wanted;
    element.onerror = function () { element.onerror = null; element.src = shown.small; };
    element.src = wanted;
  }
  // Bounds of a fitted picture in the stage, before zooming.
  function span() {
    var box = stage.getBoundingClientRect(), ratio = under.naturalWidth / under.naturalHeight || 1;
    var width = Math.min(box.width, box.height * ratio);
    return { left: (box.width - width) / 2, width: width };
  }
  function place() {
    var at = span(), box = stage.getBoundingClientRect();
    now.x = clamp(now.x, box.width * (1 - now.zoom), 0);
    now.y = clamp(now.y, box.height * (1 - now.zoom), 0);
    pan.style.transform = 'translate(' + now.x + 'px,' + now.y + 'px) scale(' + now.zoom + ')';
    pan.classList.toggle('near', now.zoom >= 3);
    var x = at.left + now.split * at.width;
    over.style.clipPath = isSplit() ? 'inset(0 0 0 ' + x + 'px)' : '';
    bar.hidden = !isSplit();
    bar.style.left = now.x + now.zoom * x + 'px';
    bar.setAttribute('aria-valuenow', Math.round(now.split * 100));
    stage.style.cursor = now.zoom > 1 ? 'move' : isSplit() ? 'ew-resize' : '';
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
  // The top layer of a view, and the layer below if there is a boundary between two.
  function layers(view) {
    var both = sides();
    if (view === 'sides') { return both.length ? [picture('prediction', both[1]), picture('prediction', both[0])] : [{ absent: '' }]; }
    if (view === 'change') { return [both.length ? picture('change', both[1]) : { absent: '' }]; }
    return view === 'compare' ? [picture('prediction'), picture('target')] : [picture(view)];
  }
  function show() {
    var label = now.method === null ? '' : data.methods[now.method].label, shown = now.pair.methods[now.method];
    one('#v-title').textContent = now.pair.scene + ' ' + now.pair.views.join(' → ');
    one('#v-sub').textContent = [data.datasets[now.pair.dataset]].concat(now.pair.facts).join(' · ');
    one('#v-scores').textContent = shown ? label + ': ' + listed(shown).map(function (line) { return line.name + ' ' + line.text; }).join(' · ') : '';
    all('[data-view]', viewer).forEach(function (button) {
      button.disabled = layers(button.dataset.view)[0].absent !== undefined;
      button.setAttribute('aria-pressed', button.dataset.view === now.view);
    });
    one('#v-methods').replaceChildren.apply(one('#v-methods'), shownMethods().map(function (method) {
      var button = make('button', { type: 'button', 'aria-pressed': method === now.method }, data.methods[method].label);
      button.addEventListener('click', function () { now.method = method; show(); });
      return button;
    }));
    var words = { change: 'Change of the error in B against A', sides: 'A | B', source: 'Source', target: 'Target', mask: 'Target, stripes where it is not scored',
      depth: 'Inverse depth of the target, near in red', 'source-depth': 'Inverse depth of the source, near in red', prediction: 'Prediction · ' + label,
      error: 'Error · ' + label, alpha: 'Alpha, black for none · ' + label, compare: 'Target | Prediction · ' + label };
    var found = layers(now.view), top = found[0], below = found[1] || top, there = top.absent === undefined;
    one('#v-what').textContent = there ? words[now.view] : top.absent ? 'no picture: ' + top.absent : 'no picture';
    over.style.display = there ? '' : 'none';
    under.style.visibility = isSplit() && below.absent === undefined ? 'visible' : 'hidden';
    if (there) { put(over, top); over.alt = words[now.view]; }
    if (below.absent === undefined) { put(under, below); }
    history.replaceState(null, '', '#pair=' + now.pair.id);
    place();
  }
  under.addEventListener('load', place);
  function enlarge(pair, method, view) {
    var visible = shownMethods();
    now.pair = pair;
    now.view = view;
    now.zoom = 1;
    now.method = [method, now.method, visible[0]].filter(function (m) { return visible.indexOf(m) >= 0; })[0];
    if (now.method === undefined) { now.method = null; }
    if (!viewer.open) { viewer.showModal(); }
    show();
  }
  function openFragment() {
    var pair = data.pairs.filter(function (pair) { return new URL('#pair=' + pair.id, location.href).hash === location.hash; })[0];
    var ranked = data.methods.map(function (method, at) { return method.ranked ? at : -1; }).filter(function (at) { return at >= 0; });
    if (pair) { enlarge(pair, ranked[0], 'prediction'); }
  }
  window.addEventListener('hashchange', openFragment);
  viewer.addEventListener('close', function () { history.replaceState(null, '', '#pairs'); });
  function step(list, item, by) { return list[(list.indexOf(item) + by + list.length) % list.length]; }
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
    } else if (isSplit()) { splitAt(event); }
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
    var views = { '1': 'source', '2': 'target', '3': 'prediction', '4': 'error', '5': 'compare', '6': 'change', '7': 'sides', m: 'mask', a: 'alpha', d: 'depth', s: 'source-depth' };
    if (event.ctrlKey || event.metaKey || event.altKey) { return; }
    var zooms = { '+': 1.5, '=': 1.5, '-': 1 / 1.5, '0': 1 / now.zoom }, visible = shownMethods();
    if (views[event.key] && one('[data-view=' + views[event.key] + ']', viewer)) { now.view = views[event.key]; }
    else if (zooms[event.key]) { zoom(zooms[event.key]); }
    else if (event.key === ' ') { now.view = now.view === 'target' ? 'prediction' : 'target'; }
    else if (event.key === 'ArrowRight' && matching.length) { now.pair = step(matching, now.pair, 1); }
    else if (event.key === 'ArrowLeft' && matching.length) { now.pair = step(matching, now.pair, matching.indexOf(now.pair) < 0 ? 0 : -1); }
    else if ((event.key === 'ArrowDown' || event.key === 'ArrowUp') && visible.length) {
      now.method = step(visible, visible.indexOf(now.method) < 0 ? visible[0] : now.method, event.key === 'ArrowDown' ? 1 : -1);
    } else { return; }
    event.preventDefault();
    show();
  });

  offerScenes();
  arrange();
  window.addEventListener('load', openFragment);
