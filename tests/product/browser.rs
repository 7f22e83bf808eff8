//! Uses the pages in a browser like a person who looks for the cause of a failure. Reported as
//! ignored, by name, if there is no Chromium.

#![allow(
    clippy::unwrap_used,
    clippy::panic,
    reason = "test code outside of #[test] functions"
)]

#[allow(dead_code, reason = "shared with the other tests of the binary")]
mod support;

use std::collections::BTreeMap;
use std::io::{ErrorKind, Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::{Command, ExitCode, Stdio};
use std::time::{Duration, Instant};

use base64::Engine as _;
use libtest_mimic::{Arguments, Trial};
use support::{read, sharp_bench, words};

fn main() -> ExitCode {
    let arguments = Arguments::from_args();
    let browser = ["chromium", "google-chrome"].into_iter().find(|program| {
        let version = Command::new(program).arg("--version").output();
        version.is_ok_and(|output| output.status.success())
    });
    let missing = if browser.is_none() {
        " (no chromium)"
    } else {
        ""
    };
    let trial = |name: &str, test: fn(&str)| {
        let run = move || {
            browser.map(test);
            Ok(())
        };
        Trial::test(format!("{name}{missing}"), run).with_ignored_flag(browser.is_none())
    };
    let trials = vec![
        trial("a report is sorted, filtered and looked through", report),
        trial("a comparison shows both sides", comparison),
        trial("a printed report has every column", printed),
        trial(
            "gaussians are drawn by webgpu as render draws them",
            gaussians,
        ),
        trial(
            "without webgpu a page of gaussians shows pictures",
            pictures,
        ),
    ];
    libtest_mimic::run(&arguments, trials).exit_code()
}

/// JavaScript functions that imitate a user's actions, for the scripts below; `said` collects their results.
const HANDS: &str = r"
  var one = function (selector) { return document.querySelector(selector); };
  var all = function (selector) { return Array.from(document.querySelectorAll(selector)); };
  var said = function (name, value) { one('#said').append(name + '=' + value + '\n'); };
  var choose = function (selector, value) {
    one(selector).value = value;
    one(selector).dispatchEvent(new Event('change', { bubbles: true }));
  };
  var press = function (key, on) { (on || one('#viewer')).dispatchEvent(new KeyboardEvent('keydown', { key: key, bubbles: true })); };
  var later = function () { return new Promise(function (done) { setTimeout(done, 300); }); };
  var titles = function () { return all('.pair h3').map(function (title) { return title.textContent; }); };
";

/// Opens a page and runs a script in it. The page is copied next to itself without its security
/// policy, which would forbid the script.
fn done(browser: &str, page: &Path, script: &str) -> BTreeMap<String, String> {
    let html = read(page);
    let policy = html.find("<meta http-equiv=").unwrap();
    let end = policy + html[policy..].find('>').unwrap() + 1;
    let script = format!(
        "<pre id=\"said\"></pre><script>addEventListener('error', function (e) {{ document.querySelector('#said').append('error=' + \
         e.message + '\\n'); }});{HANDS}addEventListener('load', async function () {{ await later(); {script} said('end', ''); }});</script>"
    );
    // Insert the script before the page's own, so that it also catches errors in that.
    let (before, after) = html[end..].rsplit_once("<script>").unwrap();
    let folder = page.parent().unwrap();
    let copy = folder.join("driven.html");
    std::fs::write(
        &copy,
        format!("{}{before}{script}<script>{after}", &html[..policy]),
    )
    .unwrap();
    let open = || {
        let output = Command::new(browser)
            .args("--headless --no-sandbox --disable-gpu --window-size=1400,900".split(' '))
            .args(["--virtual-time-budget=20000", "--dump-dom"])
            .arg(format!("file://{}", copy.canonicalize().unwrap().display()))
            .env("HOME", folder)
            .output()
            .unwrap();
        let dom = String::from_utf8(output.stdout).unwrap();
        let said = dom.split("<pre id=\"said\">").nth(1);
        let said = said.and_then(|said| said.split("</pre>").next());
        said.unwrap_or_else(|| panic!("{dom}")).to_owned()
    };
    // On a busy machine, virtual time can run out before the script ends.
    let mut said = open();
    for _ in 0..2 {
        if said.contains("\nend=") {
            break;
        }
        said = open();
    }
    let lines = said.lines().filter_map(|line| line.split_once('='));
    lines
        .map(|(name, value)| (name.to_owned(), value.to_owned()))
        .collect()
}

/// Evaluates into a folder: more pairs than fit into one file, with renderings that have an alpha
/// channel.
fn run(dir: &Path, out: &str, resolution: &str) {
    let method = format!("depth-splat:resolution={resolution}");
    let line = format!(
        "run --dataset S:synthetic=size=48x36,views=20 --method {method} --method copy \
         --metrics psnr,ssim --limit 30 --keep float --out {out}",
    );
    sharp_bench(dir, &words(&line)).ends_with(0);
}

fn is(said: &BTreeMap<String, String>, expected: &[(&str, &str)]) {
    assert_eq!(said.get("error"), None, "{said:?}");
    for (name, value) in expected {
        assert_eq!(
            said.get(*name).map(String::as_str),
            Some(*value),
            "{name}: {said:?}"
        );
    }
}

fn report(browser: &str) {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    run(dir, "r", "64");
    let json = sharp_bench(dir, &["report", "r", "--json"])
        .ends_with(0)
        .json();
    assert_eq!(json["layout"], "folder");
    let script = r"
        said('first cards', all('.pair').length);
        said('lazy', all('#cards img').every(function (image) { return image.loading === 'lazy'; }));
        one('#more').click(); await later(); one('#more').click(); await later(); one('#more').click(); await later();
        said('all cards', all('.pair').length);
        // A table by its second column, twice: upwards, then downwards.
        var head = one('table.scores thead tr:last-child th:nth-child(2)');
        var firsts = function () { return one('table.scores tbody tr th').textContent; };
        head.click(); var up = firsts(); head.click(); said('table sorted', up !== firsts());
        // Pairs by the score of one method, and only some.
        choose('#f-of', '1'); choose('#f-sort', 'up:0'); await later();
        var scores = function () {
          return all('.pair .method[data-method=\'1\'] dl div:first-child dd').map(function (dd) { return parseFloat(dd.textContent); });
        };
        var sorted = scores();
        said('scores sorted', sorted.length > 4 && sorted.every(function (score, at) { return at === 0 || sorted[at - 1] <= score; }));
        var limit = sorted[3] + 0.005;
        choose('#f-score-to', limit); await later();
        var few = parseInt(one('#count').textContent, 10);
        said('within scores', few >= 4 && few < 30 && scores().every(function (score) { return score <= limit + 0.005; }));
        choose('#f-score-to', '0'); said('none', !one('#none').hidden); choose('#f-score-to', '');
        choose('#f-baseline-to', '0.15'); await later();
        said('within baseline', all('.pair').length > 0 && all('.pair header li:nth-child(2)').every(function (li) {
          return parseFloat(li.textContent.replace('baseline', '')) <= 0.15;
        }));
        choose('#f-baseline-to', ''); choose('#f-scene', 'seed0'); said('scene', one('#count').textContent === '');
        all('#controls input[name=method]')[1].click(); await later();
        said('hidden method', all('.pair:first-child .method').length); all('#controls input[name=method]')[1].click(); await later();
        // A pair, its views, the slider, its neighbours.
        var title = titles();
        one('.pair .method[data-method=\'0\'] [data-kind=prediction] .pic').click(); await later();
        said('open', one('#viewer').open + ' ' + one('#v-what').textContent);
        said('full picture', one('#v-over').naturalWidth + ' ' + one('#v-over').getAttribute('src').indexOf('../predictions/'));
        press('5'); said('compare', one('#v-bar').hidden + ' ' + one('#v-bar').getAttribute('aria-valuenow'));
        press('ArrowRight', one('#v-bar')); said('slider', one('#v-bar').getAttribute('aria-valuenow'));
        press('End', one('#v-bar')); said('slider end', one('#v-bar').getAttribute('aria-valuenow') + ' ' + /inset\(/.test(one('#v-over').style.clipPath));
        press('4'); said('error map', one('#v-what').textContent);
        var alphas = JSON.parse(one('#data').textContent).pairs.map(function (pair) { return pair.methods[0].pictures.alpha[0]; });
        press('a'); said('alpha', one('#v-what').textContent + ' ' + (alphas.indexOf(one('#v-over').getAttribute('src')) >= 0));
        press('d'); said('depth', one('#v-what').textContent);
        press('3'); press('ArrowDown'); said('next method', one('#v-what').textContent);
        press('ArrowRight'); said('next pair', one('#v-title').textContent === title[1]);
        said('fragment', location.hash.indexOf('#pair=S/seed0/') === 0);
        var closing = new Promise(function (done) { one('#viewer').addEventListener('close', function () { setTimeout(done); }); });
        one('#v-close').click(); await closing; said('closed', !one('#viewer').open + ' ' + location.hash);";
    let said = done(browser, &dir.join("r/report/index.html"), script);
    is(
        &said,
        &[
            ("lazy", "true"),
            ("all cards", "30"),
            ("table sorted", "true"),
            ("scores sorted", "true"),
            ("within scores", "true"),
            ("none", "true"),
            ("within baseline", "true"),
            ("scene", "true"),
            ("hidden method", "1"),
            ("open", "true Prediction · depth-splat"),
            ("full picture", "48 0"),
            ("compare", "false 50"),
            ("slider", "52"),
            ("slider end", "100 true"),
            ("error map", "Error · depth-splat"),
            ("alpha", "Alpha, black for none · depth-splat true"),
            ("depth", "Inverse depth of the target, near in red"),
            ("next method", "Prediction · copy"),
            ("next pair", "true"),
            ("fragment", "true"),
            ("closed", "true #pairs"),
        ],
    );
}

fn printed(browser: &str) {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let datasets = (0..6).map(|seed| {
        let spec = format!("D{seed}:synthetic=size=48x36,views=3,seed={seed}");
        ["--dataset".to_owned(), spec]
    });
    let copies =
        (0..7).map(|number| ["--method".to_owned(), format!("copy:label=method-{number}")]);
    let options: Vec<String> = datasets.chain(copies).flatten().collect();
    let mut args = vec!["run", "--metrics", "psnr,ssim-all", "--out", "r"];
    args.extend(options.iter().map(String::as_str));
    sharp_bench(dir, &args).ends_with(0);
    sharp_bench(dir, &["report", "r"]).ends_with(0);
    // The rules for printing, on the width of a sheet of A4.
    let script = r"
        document.body.style.width = '718px';
        var lost = function () {
          return all('th, td, .col').filter(function (cell) { return cell.getBoundingClientRect().right > 719; }).length;
        };
        said('lost on a screen', lost() > 100);
        var style = one('style'), rules = style.textContent;
        var hint = function () { return getComputedStyle(one('.plot figcaption'), '::after'); };
        said('hint', hint().content);
        style.textContent = rules.replace('@media (max-width: 720px)', '@media all'); await later();
        said('hint on a narrow screen', hint().content.includes('scroll'));
        style.textContent = style.textContent.replace('@media print', '@media all'); await later();
        said('hint on paper', hint().display);
        style.textContent = rules.replace('@media print', '@media all'); await later();
        said('columns', all('table.wide').length > 2 && all('.pair:first-of-type .col').length > 7);
        said('lost on paper', lost());";
    let said = done(browser, &dir.join("r/report/index.html"), script);
    is(
        &said,
        &[
            ("lost on a screen", "true"),
            ("hint", "none"),
            ("hint on a narrow screen", "true"),
            ("hint on paper", "none"),
            ("columns", "true"),
            ("lost on paper", "0"),
        ],
    );
}

fn comparison(browser: &str) {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    run(dir, "a", "64");
    run(dir, "b", "32");
    sharp_bench(dir, &["compare", "a", "b", "--out", "page"]).ends_with(0);
    let script = r"
        var losses = JSON.parse(one('#data').textContent).pairs.map(function (pair) { return pair.losses[0]; });
        choose('#f-change', 'worse'); await later();
        var worse = losses.filter(function (loss) { return loss > 0; }).length;
        said('worse', one('#count').textContent === (worse === losses.length ? '' : worse + ' of 30 pairs match.'));
        choose('#f-change', ''); await later();
        one('.pair [data-kind=change] .pic').click(); await later();
        said('change', one('#v-what').textContent);
        press('7'); await later(); said('sides', one('#v-what').textContent + ' ' + one('#v-bar').hidden);
        said('both', one('#v-over').getAttribute('src') !== one('#v-under').getAttribute('src') &&
          one('#v-under').naturalWidth === 48 && one('#v-under').style.visibility);
        press('5'); said('against the target', one('#v-what').textContent.indexOf('Target | Prediction'));";
    let said = done(browser, &dir.join("page/index.html"), script);
    is(
        &said,
        &[
            ("worse", "true"),
            ("change", "Change of the error in B against A"),
            ("sides", "A | B false"),
            ("both", "visible"),
            ("against the target", "0"),
        ],
    );
}

/// A predicted scene of the network's tiny variant, 18,432 Gaussians.
const SCENE: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../tests/golden/model/tiny_golden.ply"
);

/// Gaussians with colours of degree 1, not in the space of a camera.
const VIEW_DEPENDENT: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../tests/fixtures/gaussian_formats/src_d1.ply"
);

/// The viewer's pictures differ from those of `render` by at most one level: the first frame and one
/// from elsewhere on the path, with SHARP's rule and with others.
fn gaussians(browser: &str) {
    let camera = r#"{"width":61,"height":43,"K":[50,0,24,0,50,26,0,0,1],
        "camera_from_world":[1,0,0,0,0,1,0,0,0,0,1,0.5,0,0,0,1]}"#;
    for (scene, more) in [
        (SCENE, vec![]),
        (
            VIEW_DEPENDENT,
            words("--camera cam.json --rendering inria-aa --background 1,0.5,0"),
        ),
        (
            VIEW_DEPENDENT,
            vec!["--camera", "cam.json", "--rendering", "inria"],
        ),
    ] {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join("cam.json"), camera).unwrap();
        frames_of_a_page(browser, dir.path(), &[&[scene], &more[..]].concat());
    }
}

fn frames_of_a_page(browser: &str, dir: &Path, scene: &[&str]) {
    let path = ["--trajectory", "rotate_forward", "--frames", "5"];
    sharp_bench(
        dir,
        &[
            &["render"],
            scene,
            &path[..],
            &["--out", "frames", "--viewer", "page.html"],
        ]
        .concat(),
    )
    .ends_with(0);
    let script = "
        const sent = [];
        new MutationObserver(() => {
          if (document.body.dataset.pictures) { send(document.body.dataset.pictures); return; }
          if (document.body.dataset.drawn !== String(sent.length + 1)) { return; }
          sent.push(document.querySelector('canvas').toDataURL('image/png').split(',')[1]);
          if (sent.length === 2) { send(sent.join(' ') + ' ' + document.querySelector('#pose').textContent); return; }
          const range = document.querySelector('#frame');
          range.value = 3;
          // Once the first drawing has ended.
          setTimeout(() => range.dispatchEvent(new Event('input')), 0);
        }).observe(document.body, { attributes: true });";
    let flags = ["--enable-unsafe-webgpu", "--use-webgpu-adapter=swiftshader"];
    let said = sent(browser, &dir.join("page.html"), &flags, script);
    let (first, rest) = said.split_once(' ').unwrap_or_else(|| panic!("{said}"));
    let (fourth, pose) = rest.split_once(' ').unwrap_or_else(|| panic!("{said}"));
    for (picture, frame) in [(first, "frame-00000.png"), (fourth, "frame-00003.png")] {
        let bytes = base64::engine::general_purpose::STANDARD.decode(picture);
        let drawn = image::load_from_memory(&bytes.unwrap_or_else(|_| panic!("{said}")));
        let drawn = drawn.unwrap().into_rgb8();
        let rendered = image::open(dir.join("frames").join(frame))
            .unwrap()
            .into_rgb8();
        assert_eq!(drawn.dimensions(), rendered.dimensions());
        let levels = drawn.iter().zip(rendered.iter());
        let farthest = levels.map(|(a, b)| a.abs_diff(*b)).max();
        assert!(farthest <= Some(1), "{frame}: {farthest:?} levels apart");
    }
    assert!(
        pose.starts_with("Camera 0.") && pose.contains("turned by"),
        "{pose}"
    );
}

fn pictures(browser: &str) {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let path = ["render", SCENE, "--trajectory", "swipe", "--frames", "30"];
    sharp_bench(dir, &[&path[..], &["--viewer", "page.html"]].concat()).ends_with(0);
    let script = "
        addEventListener('load', async () => {
          for (let i = 0; i < 100 && !document.body.dataset.pictures; i++) { await new Promise((done) => setTimeout(done, 50)); }
          const shown = () => Array.from(document.querySelectorAll('main img')).map((image, at) => image.hidden ? '' : at).join('');
          const range = document.querySelector('#frame'), first = shown();
          range.value = 16;
          range.dispatchEvent(new Event('input'));
          send([first, shown(), range.value, document.querySelector('#what').textContent].join('|'));
        });";
    let said = sent(
        browser,
        &dir.join("page.html"),
        &["--disable-features=WebGPU", "--disable-gpu"],
        script,
    );
    // Twelve of thirty views: every 29/11th.
    assert_eq!(
        said,
        "0|6|15|This browser has no WebGPU here: showing 12 pictures rendered with the page."
    );
}

/// Opens a page without its security policy but with a script of the test before its own, and
/// returns what that script sends. Runs in real time, because a browser with virtual time does not
/// wait for a GPU.
fn sent(browser: &str, page: &Path, flags: &[&str], script: &str) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    listener.set_nonblocking(true).unwrap();
    let html = read(page);
    let policy = html.find("<meta http-equiv=").unwrap();
    let end = policy + html[policy..].find('>').unwrap() + 1;
    let (before, after) = html[end..].rsplit_once("<script>").unwrap();
    let folder = page.parent().unwrap();
    let copy = folder.join("driven.html");
    let text = format!(
        "{}{before}<script>const send = (text) => fetch('http://{}/', {{ method: 'POST', mode: 'no-cors', body: text }});
         addEventListener('error', (event) => send('error ' + event.message));
         addEventListener('unhandledrejection', (event) => send('error ' + event.reason));
         {{ {script} }}</script><script>{after}",
        &html[..policy],
        listener.local_addr().unwrap()
    );
    std::fs::write(&copy, text).unwrap();
    let mut opened = Command::new(browser)
        .args(["--headless", "--no-sandbox", "--remote-debugging-port=0"])
        .arg(format!(
            "--user-data-dir={}",
            folder.join("profile").display()
        ))
        .args(flags)
        .arg(format!("file://{}", copy.canonicalize().unwrap().display()))
        .env("HOME", folder)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let until = Instant::now() + Duration::from_secs(120);
    let said = loop {
        match listener.accept() {
            Ok((stream, _)) => break body(stream),
            Err(error) if error.kind() == ErrorKind::WouldBlock && Instant::now() < until => {
                std::thread::sleep(Duration::from_millis(20));
            }
            Err(error) => break format!("nothing was sent: {error}"),
        }
    };
    opened.kill().unwrap();
    opened.wait().unwrap();
    said
}

/// The body of a POST request.
fn body(mut stream: TcpStream) -> String {
    stream.set_nonblocking(false).unwrap();
    let mut request = Vec::new();
    let mut part = [0; 1 << 16];
    loop {
        let text = String::from_utf8_lossy(&request);
        if let Some((head, body)) = text.split_once("\r\n\r\n") {
            let length = head.lines().find_map(|line| {
                let (name, value) = line.split_once(':')?;
                name.eq_ignore_ascii_case("content-length").then_some(value)
            });
            let length: usize = length.unwrap().trim().parse().unwrap();
            if body.len() >= length {
                stream
                    .write_all(b"HTTP/1.1 204 No Content\r\n\r\n")
                    .unwrap();
                return body.to_owned();
            }
        }
        let read = stream.read(&mut part).unwrap();
        assert!(read > 0, "the browser hung up");
        request.extend_from_slice(&part[..read]);
    }
}
