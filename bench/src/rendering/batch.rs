//! Renders many views of one scene: uploads the scene once, and falls back to the CPU if the device
//! fails.

use sharp::gaussians::Gaussians;
use sharp::render::{Backend, CpuRenderer, RenderError, RenderOutput, RenderView, Renderer};

/// Renders batches of views. After a device is lost or runs out of memory, renders all remaining views on the CPU.
pub struct BatchRenderer {
    device: Option<Box<dyn Renderer>>,
    cpu: CpuRenderer,
    reason: Option<String>,
    fallback: Option<String>,
}

impl BatchRenderer {
    /// Opens a backend. A device that exists but cannot be opened counts as a failed device.
    ///
    /// # Errors
    /// [`RenderError::NoAdapter`] if a requested adapter does not exist; `auto` never fails.
    pub fn open(backend: &Backend) -> Result<Self, RenderError> {
        let mut opened = Self {
            device: None,
            cpu: CpuRenderer::new(),
            reason: None,
            fallback: None,
        };
        let wanted = match backend {
            Backend::Cpu => return Ok(opened),
            Backend::Auto => &Backend::Wgpu(None),
            named => named,
        };
        match (wanted.open(), backend) {
            (Ok(device), _) => {
                opened.device = Some(device);
                if *backend == Backend::Auto {
                    opened.reason = Some("the first hardware adapter".to_owned());
                }
            }
            (Err(error), _) if error.is_device_fault() => opened.give_up(&error),
            (Err(error), Backend::Auto) => opened.reason = Some(error.to_string()),
            (Err(error), _) => return Err(error),
        }
        Ok(opened)
    }

    /// Why `auto` chose this backend; `None` for any other request.
    pub fn reason(&self) -> Option<&str> {
        self.reason.as_deref()
    }

    /// Backend that renders the next view: `cpu-avx512`, `wgpu:<adapter>`.
    pub fn name(&self) -> String {
        match &self.device {
            Some(device) => device.name(),
            None => self.cpu.name(),
        }
    }

    /// Why rendering fell back from a device to the CPU; `None` if it did not fall back.
    pub fn fallback(&self) -> Option<&str> {
        self.fallback.as_deref()
    }

    /// Renders views in order. Each finished picture is passed to `done(index, picture)`, whose error ends the batch.
    ///
    /// # Errors
    /// Errors of `done`, and any [`RenderError`] that is not a device failure.
    pub fn render<E: From<RenderError>>(
        &mut self,
        scene: &Gaussians,
        views: &[RenderView],
        mut done: impl FnMut(usize, RenderOutput) -> Result<(), E>,
    ) -> Result<(), E> {
        let mut next = 0;
        if let Some(device) = &mut self.device {
            let mut each = || -> Result<(), Stop<E>> {
                let mut loaded = device.load(scene).map_err(Stop::Render)?;
                for view in views {
                    let picture = loaded.render(view).map_err(Stop::Render)?;
                    done(next, picture).map_err(Stop::Done)?;
                    next += 1;
                }
                Ok(())
            };
            match each() {
                Ok(()) => return Ok(()),
                Err(Stop::Done(error)) => return Err(error),
                Err(Stop::Render(error)) if error.is_device_fault() => self.give_up(&error),
                Err(Stop::Render(error)) => return Err(error.into()),
            }
        }
        for (index, view) in views.iter().enumerate().skip(next) {
            done(index, self.cpu.render(scene, view)?)?;
        }
        Ok(())
    }

    fn give_up(&mut self, error: &RenderError) {
        self.device = None;
        self.fallback = Some(error.to_string());
    }
}

enum Stop<E> {
    Render(RenderError),
    Done(E),
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicUsize, Ordering};

    use glam::DAffine3;
    use sharp::camera::Intrinsics;
    use sharp::render::LoadedScene;

    use super::*;

    /// A device that counts uploads and is lost after a number of views.
    struct Fragile {
        uploads: Arc<AtomicUsize>,
        views_left: usize,
    }

    impl Renderer for Fragile {
        fn name(&self) -> String {
            "wgpu:fragile".to_owned()
        }

        fn load<'a>(
            &'a mut self,
            scene: &'a Gaussians,
        ) -> Result<Box<dyn LoadedScene + 'a>, RenderError> {
            self.uploads.fetch_add(1, Ordering::Relaxed);
            Ok(Box::new(Loaded(self, scene)))
        }
    }

    struct Loaded<'a>(&'a mut Fragile, &'a Gaussians);

    impl LoadedScene for Loaded<'_> {
        fn render(&mut self, view: &RenderView) -> Result<RenderOutput, RenderError> {
            if self.0.views_left == 0 {
                return Err(RenderError::DeviceLost {
                    adapter: "fragile".to_owned(),
                    what: "a test".to_owned(),
                });
            }
            self.0.views_left -= 1;
            CpuRenderer::new().render(self.1, view)
        }
    }

    fn scene() -> Gaussians {
        Gaussians::new(
            vec![[0.0, 0.0, 2.0]],
            vec![[1.0, 0.0, 0.0, 0.0]],
            vec![[0.2; 3]],
            vec![0.9],
            vec![[0.5; 3]],
        )
        .unwrap()
    }

    fn views() -> Vec<RenderView> {
        let k = Intrinsics::new((10.0, 10.0), (4.0, 4.0), (8, 8)).unwrap();
        (0..4)
            .map(|step| {
                let moved = DAffine3::from_translation(glam::DVec3::new(f64::from(step), 0.0, 0.0));
                RenderView::new(moved, k)
            })
            .collect()
    }

    fn with_views_left(views_left: usize) -> (BatchRenderer, Arc<AtomicUsize>) {
        let uploads = Arc::new(AtomicUsize::new(0));
        let device = Fragile {
            uploads: Arc::clone(&uploads),
            views_left,
        };
        let renderer = BatchRenderer {
            device: Some(Box::new(device)),
            cpu: CpuRenderer::new(),
            reason: None,
            fallback: None,
        };
        (renderer, uploads)
    }

    fn render(renderer: &mut BatchRenderer, views: &[RenderView]) -> Vec<(usize, RenderOutput)> {
        let mut found = Vec::new();
        renderer
            .render(&scene(), views, |index, picture| {
                found.push((index, picture));
                Ok::<(), RenderError>(())
            })
            .unwrap();
        found
    }

    #[test]
    fn a_batch_uploads_once() {
        let (mut renderer, uploads) = with_views_left(100);
        assert_eq!(render(&mut renderer, &views()).len(), 4);
        assert_eq!(uploads.load(Ordering::Relaxed), 1);
        assert_eq!(renderer.fallback(), None);
        assert_eq!(renderer.name(), "wgpu:fragile");
    }

    #[test]
    fn the_cpu_goes_on_where_a_lost_device_stopped() {
        let expected: Vec<_> = views()
            .iter()
            .map(|view| CpuRenderer::new().render(&scene(), view).unwrap())
            .enumerate()
            .collect();
        for lost_at in 0..4 {
            let (mut renderer, uploads) = with_views_left(lost_at);
            assert_eq!(render(&mut renderer, &views()), expected);
            assert!(renderer.fallback().unwrap().contains("lost"));
            assert!(renderer.name().starts_with("cpu-"));
            // The lost device is not tried again.
            render(&mut renderer, &views());
            assert_eq!(uploads.load(Ordering::Relaxed), 1);
        }
    }

    #[test]
    fn other_errors_end_the_batch() {
        let (mut renderer, _) = with_views_left(2);
        let mut bad = views();
        bad[1].rule.low_pass = f32::NAN;
        let result = renderer.render(&scene(), &bad, |_, _| Ok::<(), RenderError>(()));
        assert!(matches!(result, Err(RenderError::View(_))));
        assert_eq!(renderer.fallback(), None);
    }

    #[test]
    fn auto_says_why_and_a_missing_adapter_is_an_error() {
        let auto = BatchRenderer::open(&Backend::Auto).unwrap();
        assert!(auto.reason().is_some() || auto.fallback().is_some());
        assert!(!auto.name().contains("[software]"), "{}", auto.name());
        let cpu = BatchRenderer::open(&Backend::Cpu).unwrap();
        assert!(cpu.name().starts_with("cpu-") && cpu.reason().is_none());
        let absent = Backend::Wgpu(Some("no such adapter".to_owned()));
        let error = BatchRenderer::open(&absent).err().unwrap();
        assert!(matches!(error, RenderError::NoAdapter(_)));
    }
}
