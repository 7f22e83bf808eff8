//! Downloads use the proxy given by the environment. This test has its own process, because it
//! changes the environment.

use sharp_checkpoint::download::Download;
use sharp_tests::unreliable_server::{Answer, Server};

#[test]
fn the_proxy_of_the_environment_is_asked() {
    let proxy = Server::start(Vec::new(), "v1", vec![Answer::Status(403)]);
    // SAFETY: this is the only test of its process, and no other thread of it reads or writes the environment.
    unsafe { std::env::set_var("ALL_PROXY", proxy.host()) };
    let folder = tempfile::tempdir().unwrap();
    let download = Download {
        // A reserved name: no such host exists, so only a proxy can answer.
        address: "http://weights.invalid/sharp.pt".to_owned(),
        sizes: 1..=100,
        size_text: "7 bytes".to_owned(),
    };
    let error = download.fetch(&folder.path().join("part"), |_| {});
    assert!(error.unwrap_err().to_string().contains("weights.invalid"));
    let requests = proxy.requests();
    assert!(requests[0].contains("weights.invalid"), "{requests:?}");
}
