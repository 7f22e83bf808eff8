  // Pairs: cards made from the data as they come into view; filters and order.
  var cards = one('#cards');
  if (!cards) { return; }
  var data = JSON.parse(one('#data').textContent), more = one('#more');
  data.pairs.forEach(function (pair, at) { pair.order = at; });
  // Number of cards created at once.
  var STEP = 8;

  // Text from the data is inserted as text, never as markup.
  function make(name, attributes, children) {
    var element = document.createElement(name);
    Object.keys(attributes).forEach(function (key) { element.setAttribute(key, attributes[key]); });
    [].concat(children || []).forEach(function (child) { element.append(child); });
    return element;
  }
  function swatch(method) { return make('i', { style: 'background:' + data.methods[method].colour }); }

  function shownMethods() {
    return all('#controls input[name=method]').filter(function (box) { return box.checked; }).map(function (box) { return +box.value; });
  }
  // A score is a number with its text, or the reason why there is none.
  function scoreOf(pair, metric, method) {
    var shown = pair.methods[method], score = shown && shown.scores && shown.scores[metric];
    return score && typeof score !== 'string' ? number(score[0]) : null;
  }
  function meanScore(pair, metric, methods) {
    var values = methods.map(function (method) { return scoreOf(pair, metric, method); }).filter(function (value) { return value !== null; });
    return values.length ? values.reduce(function (a, b) { return a + b; }, 0) / values.length : null;
  }
  function entered(id) { var input = one(id); return input ? number(input.value) : null; }
  // Pairs without a number match only the full range.
  function within(value, from, to) {
    if (from === null && to === null) { return true; }
    return value !== null && (from === null || value >= from) && (to === null || value <= to);
  }

  // The pairs that pass the filters, in display order, and the number of them that have a card.
  var matching = [], drawn = 0;
  function arrange() {
    var dataset = one('#f-dataset').value, scene = one('#f-scene').value, of = one('#f-of').value;
    var methods = of === '' ? shownMethods() : [+of];
    var baseline = [entered('#f-baseline-from'), entered('#f-baseline-to')], range = [entered('#f-score-from'), entered('#f-score-to')];
    var metric = one('#f-metric') ? +one('#f-metric').value : 0;
    var sort = one('#f-sort').value.split(':'), change = one('#f-change') ? one('#f-change').value : '';
    // By how much B is worse than A, if the page compares two runs.
    var lossOf = sort[1] && sort[1].indexOf('loss-') === 0 ? +sort[1].slice(5) : null;
    function key(pair) {
      if (sort[0] === 'order') { return pair.order; }
      if (lossOf !== null) { return pair.losses ? number(pair.losses[lossOf]) : null; }
      return sort[1] === 'baseline' || sort[1] === 'overlap' ? number(pair[sort[1]]) : meanScore(pair, +sort[1], methods);
    }
    matching = data.pairs.filter(function (pair) {
      var lost = pair.losses ? pair.losses[lossOf || 0] : null;
      return (dataset === '' || pair.dataset === +dataset) && (scene === '' || pair.scene === scene) &&
        within(number(pair.baseline), baseline[0], baseline[1]) && within(meanScore(pair, metric, methods), range[0], range[1]) &&
        (change === '' || (change === 'worse' ? lost > 0 : lost < 0));
    }).map(function (pair) { return [key(pair), pair]; })
      .sort(function (a, b) { return byValue(a[0], b[0], sort[0] === 'down') || a[1].order - b[1].order; })
      .map(function (entry) { return entry[1]; });
    one('#none').hidden = matching.length > 0;
    one('#count').textContent = matching.length === data.pairs.length ? '' : matching.length + ' of ' + data.pairs.length + ' pairs match.';
    cards.textContent = '';
    drawn = 0;
    draw();
  }
  function draw() {
    var methods = shownMethods(), next = matching.slice(drawn, drawn + STEP);
    cards.append.apply(cards, next.map(function (pair) { return card(pair, methods); }));
    drawn += next.length;
    more.hidden = drawn >= matching.length;
    // Observed again, in case it is still in view.
    watcher.unobserve(more);
    if (!more.hidden) { watcher.observe(more); }
  }
  var watcher = new IntersectionObserver(function (entries) {
    if (entries.some(function (entry) { return entry.isIntersecting; })) { draw(); }
  }, { rootMargin: '1200px' });
  more.addEventListener('click', draw);

  function figure(pair, method, kind, caption, alt) {
    var picture = (method === null ? pair : pair.methods[method]).pictures[kind];
    var shown = make('figure', { 'data-kind': kind });
    if (typeof picture === 'string') {
      shown.append(make('p', { class: 'absent' }, picture));
    } else {
      var image = make('img', { src: picture[0], width: picture[1], height: picture[2], alt: alt, decoding: 'async', loading: 'lazy' });
      var button = make('button', { type: 'button', class: 'pic' }, image);
      button.addEventListener('click', function () { enlarge(pair, method, kind); });
      shown.append(button);
      if (kind === 'prediction') { flips(shown, image, button, pair); }
    }
    shown.append(make('figcaption', {}, caption));
    return shown;
  }
  // A prediction shows the target while hovered or focused.
  function flips(shown, image, button, pair) {
    var target = pair.pictures.target, own = image.getAttribute('src');
    if (typeof target === 'string') { return; }
    function flip(on) {
      image.src = on ? target[0] : own;
      one('figcaption', shown).textContent = on ? 'Target' : 'Prediction';
      shown.classList.toggle('flipped', on);
    }
    shown.addEventListener('pointerenter', function () { flip(true); });
    shown.addEventListener('pointerleave', function () { flip(false); });
    button.addEventListener('keydown', function (event) {
      if (event.key === ' ' || event.key === 'f') { event.preventDefault(); flip(!shown.classList.contains('flipped')); }
    });
    button.addEventListener('blur', function () { flip(false); });
  }
  // Names with their values: scores, values reported by the method, or the reason for a failure.
  function listed(shown) {
    if (shown.failed !== undefined) { return [{ name: 'failed', text: shown.failed, bad: true }]; }
    return shown.scores.map(function (score, metric) {
      var absent = typeof score === 'string';
      return { name: data.heads[metric], text: absent ? 'n/a' : score[1], key: data.keys[metric], why: absent ? score : '' };
    }).concat(shown.extras.map(function (extra) { return { name: extra[0], text: extra[1], extra: true }; }));
  }
  function column(pair, method) {
    var shown = pair.methods[method], label = data.methods[method].label;
    var what = pair.scene + ', ' + pair.views.join(' to ');
    var inside = [make('h4', {}, [swatch(method), label])];
    if (!shown) { return make('div', { class: 'col method', 'data-method': method }, inside.concat(make('p', { class: 'absent' }, 'no record of this pair'))); }
    inside.push(figure(pair, method, 'prediction', 'Prediction', 'Prediction by ' + label + ' of ' + what));
    inside.push(figure(pair, method, 'error', 'Error', 'Absolute error of ' + label + ' on ' + what));
    if (shown.pictures.change) { inside.push(figure(pair, method, 'change', 'Change', 'Change of the absolute error in ' + label + ' on ' + what)); }
    inside.push(make('dl', {}, listed(shown).map(function (line) {
      return make('div', line.bad ? { class: 'bad' } : line.extra ? { class: 'extra' } : {}, [
        make('dt', line.key ? { title: line.key } : {}, line.name), make('dd', line.why ? { title: line.why } : {}, line.text)]);
    })));
    if (shown.viewer) { inside.push(make('p', { class: 'viewer' }, make('a', { href: shown.viewer }, 'Its Gaussians'))); }
    return make('div', { class: 'col method', 'data-method': method }, inside);
  }
  function card(pair, methods) {
    var what = pair.scene + ', ' + pair.views.join(' to ');
    var title = make('h3', {}, make('a', { href: '#pair=' + pair.id }, [pair.scene + ' ', make('span', {}, pair.views.join(' → '))]));
    var facts = [make('li', {}, make('b', {}, data.datasets[pair.dataset]))].concat(pair.facts.map(function (fact) { return make('li', {}, fact); }));
    var views = make('div', { class: 'col views' }, [make('h4', {}, 'Input and truth'),
      figure(pair, null, 'source', 'Source', 'Source photograph of ' + what), figure(pair, null, 'target', 'Target', 'Target photograph of ' + what)]);
    return make('article', { class: 'pair' }, [make('header', {}, [title, make('ul', {}, facts)]),
      make('div', { class: 'strip' }, [views].concat(methods.map(function (method) { return column(pair, method); })))]);
  }

  // The scenes of the selected dataset.
  function offerScenes() {
    var dataset = one('#f-dataset').value, list = one('#f-scene'), names = {};
    data.pairs.forEach(function (pair) { if (dataset === '' || pair.dataset === +dataset) { names[pair.scene] = true; } });
    list.length = 1;
    Object.keys(names).sort(function (a, b) { return a.localeCompare(b, 'en', { numeric: true }); })
      .forEach(function (name) { list.append(make('option', { value: name }, name)); });
  }
  one('#f-dataset').addEventListener('change', offerScenes);
  one('#controls').addEventListener('change', arrange);

