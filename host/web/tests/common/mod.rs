//! An emulated rig with its service and its page, in this process.

#![allow(dead_code, reason = "each test program needs a part")]

use known::store::Store;
use rig::{Rig, DEFAULT_NAME, DEFAULT_TEXT};
use run::{NoopObserver, Zeroing};
use service::socket::Listening;
use service::{serve, ServeOptions};
use session::link::fast::FastRig;
use session::link::EmbeddedOptions;
use session::Session;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::Arc;
use std::thread::JoinHandle;
use tempfile::TempDir;
use web::WebOptions;

/// See the module's page. Ends with it.
pub struct Served {
    _folder: TempDir,
    /// The link to the page.
    pub link: String,
    stop: Arc<AtomicBool>,
    service: Option<JoinHandle<()>>,
}

impl Served {
    /// A rig that is ready, its time that of the clock on the wall.
    pub fn new(token: Option<&str>) -> Self {
        Self::with(token, None)
    }

    /// The same with a store of the rig's bring-up.
    pub fn with(token: Option<&str>, store: Option<Store>) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let options = EmbeddedOptions {
            paced: true,
            ..EmbeddedOptions::default()
        };
        let mut link = FastRig::open(&options).unwrap();
        let stop = Arc::new(AtomicBool::new(false));
        let mut session = Session::connect(&mut link).unwrap();
        let rig = Rig::built_in().unwrap();
        let zeroing = Zeroing::Measure;
        run::ready_board(&mut session, &rig, &zeroing, &stop, &mut NoopObserver).unwrap();
        drop(session);
        let listening = Listening::bind_at(folder.path().join("rig.sock")).unwrap();
        let link_to_page = web::start(WebOptions {
            address: "127.0.0.1:0".parse().unwrap(),
            token: token.map(str::to_owned),
            socket: listening.path().to_owned(),
            // Takes any words and does nothing.
            program: "true".into(),
            link: "rig:rig".to_owned(),
        })
        .unwrap();
        let ends = Arc::clone(&stop);
        let service = std::thread::spawn(move || {
            let options = ServeOptions {
                name: "rig".to_owned(),
                rig_file: (DEFAULT_NAME.to_owned(), DEFAULT_TEXT.to_owned()),
                store,
                stop: ends,
                ..ServeOptions::default()
            };
            serve(Box::new(link), listening, options, |_| {}).unwrap();
        });
        Self {
            _folder: folder,
            link: link_to_page,
            stop,
            service: Some(service),
        }
    }

    /// `127.0.0.1:PORT`.
    pub fn host(&self) -> &str {
        let rest = self.link.strip_prefix("http://").unwrap();
        rest.split('/').next().unwrap()
    }

    /// Ends the service; the page stays.
    pub fn end_service(&mut self) {
        self.stop.store(true, Ordering::SeqCst);
        if let Some(service) = self.service.take() {
            service.join().unwrap();
        }
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::SeqCst);
    }
}
