  var root = document.documentElement;
  root.classList.add('scripted');
  function all(selector, within) { return Array.from((within || document).querySelectorAll(selector)); }
  function one(selector, within) { return (within || document).querySelector(selector); }

  // Theme: the system's until someone chooses.
  one('#theme').addEventListener('click', function () {
    var dark = root.dataset.theme ? root.dataset.theme === 'dark' : matchMedia('(prefers-color-scheme: dark)').matches;
    root.dataset.theme = dark ? 'light' : 'dark';
  });

  // A number from a cell or from the data; entries without one come last in either direction.
  function number(text) {
    if (text === undefined || text === null || text === '') { return null; }
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
          return byValue(number(a.children[column].dataset.value), number(b.children[column].dataset.value), down);
        }).forEach(function (row) { body.appendChild(row); });
      }
      head.addEventListener('click', sort);
      head.addEventListener('keydown', function (event) {
        if (event.key === 'Enter' || event.key === ' ') { event.preventDefault(); sort(); }
      });
    });
  });

