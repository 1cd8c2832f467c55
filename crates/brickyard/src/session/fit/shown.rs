//! Pictures that a fit's GPU renderer shows without anybody waiting for them, and what is answered about them later: what rays saw goes to the
//! pagers, as of the frame that it was seen in.

use crate::session::fit::{Fit, Pool, drawn};
use crate::session::renderer::BackendError;
use crate::session::resolve::ResolvedScene;
use brickyard_pager::DrawnCells;
use brickyard_render::{Answer, Compositor};
use std::collections::VecDeque;
use std::ops::Range;

/// The GPU's answers about the pictures that a fit has shown.
#[derive(Default)]
pub(crate) struct Shown {
    /// How many there were.
    pictures: u64,
    /// Whether answers will come about all eyes of the present scene drawn so far.
    is_asked: bool,
    /// Pictures whose answers the pagers are to be told, the oldest first.
    asked: VecDeque<Asked>,
    /// Milliseconds that a picture took on the GPU, by the last answer that says so; `None` before there is one.
    pub(crate) gpu_ms: Option<f64>,
    /// The numbers of pictures and their times on the GPU, milliseconds, since they were last taken.
    pub(crate) times_ms: Vec<(u64, f64)>,
    /// Answers held back, the oldest first: for tests.
    held_back: VecDeque<Vec<Answer>>,
    /// Number of steps for which answers are held back: for tests.
    pub(crate) late_steps: usize,
}

/// A question about the picture of a scene, or its two.
struct Asked {
    pictures: Range<u64>,
    /// The drawn cells of each layer, and the light seen in them in the pictures answered so far.
    drawn: Vec<Option<DrawnCells>>,
    seen: Vec<Vec<f32>>,
}

impl Fit {
    /// Draws a scene from the bricks in the slots into the GPU renderer's own texture, without waiting. If `tells`, the pagers are told later what was
    /// seen. Of `rows` of a scene without meshes only these are drawn, where the right eye's follow the left eye's. Returns whether the picture is
    /// whole.
    pub(crate) fn show(
        &mut self,
        scene: &ResolvedScene,
        rows: Option<Range<u32>>,
        tells: bool,
    ) -> Result<bool, BackendError> {
        let Self { layers: own, pools, backend, shown, .. } = self;
        let Some(gpu) = backend.as_gpu() else { return Ok(false) };
        let (eyes, height) = (scene.eyes(), scene.rows() / scene.eyes() as u32);
        for eye in 0..eyes {
            let of_eye = rows.as_ref().map(|rows| {
                let above = eye as u32 * height;
                rows.start.saturating_sub(above).min(height)..rows.end.saturating_sub(above).min(height)
            });
            if of_eye.as_ref().is_some_and(Range::is_empty) {
                continue;
            }
            if eye == 1 && of_eye.as_ref().is_none_or(|rows| rows.start == 0) {
                gpu.keep_left()?;
            }
            let (layers, combination) = (drawn(own, scene, eye), scene.combination.as_ref());
            let is_asked = match of_eye {
                None => gpu.show(&layers, combination, shown.pictures)?,
                Some(rows) => match gpu.show_rows(&layers, combination, shown.pictures, rows)? {
                    Some(is_asked) => is_asked,
                    None => return Ok(false),
                },
            };
            shown.is_asked = is_asked && (eye == 0 || shown.is_asked);
            shown.pictures += 1;
        }
        if rows.is_some_and(|rows| rows.end < scene.rows()) {
            return Ok(false);
        }
        if shown.is_asked && tells && own.iter().all(|layer| layer.draws.len() == eyes) {
            let mut drawn = vec![None; own.len()];
            for Pool { layers, pager, .. } in pools {
                layers.iter().enumerate().for_each(|(volume, &layer)| drawn[layer] = pager.drawn(volume));
            }
            let seen = vec![Vec::new(); own.len()];
            let pictures = shown.pictures - eyes as u64..shown.pictures;
            shown.asked.push_back(Asked { pictures, drawn, seen });
        }
        Ok(true)
    }

    /// Draws a scene like [`Fit::show`], but by another compositor, and leaves it to be drawn over. Returns the picture's
    /// number if its time will be known, and the next picture's number is one greater; `None`, and draws nothing, while
    /// pipelines are compiled.
    pub(crate) fn show_by(
        &mut self,
        compositor: Compositor,
        scene: &ResolvedScene,
    ) -> Result<Option<u64>, BackendError> {
        let Self { layers: own, backend, shown, .. } = self;
        let Some(gpu) = backend.as_gpu() else { return Ok(None) };
        let (layers, combination, usual) = (drawn(own, scene, 0), scene.combination.as_ref(), gpu.compositor());
        if !gpu.set_compositor(compositor) {
            return Ok(None);
        }
        let is_prepared = gpu.is_prepared(&layers, combination);
        let asked = match is_prepared {
            true => gpu.show(&layers, combination, shown.pictures),
            false => {
                gpu.prepare(&layers, combination);
                Ok(false)
            }
        };
        gpu.set_compositor(usual);
        let number = shown.pictures;
        shown.pictures += u64::from(is_prepared);
        Ok(asked?.then_some(number))
    }

    /// Whether the picture shown last lacks layers of translucent meshes; `None` while that is not known.
    pub(crate) fn lacks_layers(&mut self) -> Option<bool> {
        self.backend.as_gpu().map_or(Some(false), |gpu| gpu.lacks_layers())
    }

    /// Takes the GPU's answers about pictures shown before, and tells the pagers what was seen.
    pub(crate) fn hear(&mut self) -> Result<(), BackendError> {
        let Self { backend, shown, .. } = self;
        let Some(gpu) = backend.as_gpu() else { return Ok(()) };
        shown.held_back.push_back(gpu.answers()?);
        while self.shown.held_back.len() > self.shown.late_steps
            && let Some(answers) = self.shown.held_back.pop_front()
        {
            for answer in answers {
                self.shown.gpu_ms = answer.gpu_ms.or(self.shown.gpu_ms);
                self.shown.times_ms.extend(answer.gpu_ms.map(|ms| (answer.picture, ms)));
                if let Some(visibility) = &answer.visibility {
                    self.tell(answer.picture, visibility);
                }
            }
        }
        Ok(())
    }

    /// Takes in what was seen in a picture, layer by layer; with the last picture of a scene the pagers are told.
    fn tell(&mut self, picture: u64, visibility: &[Vec<f32>]) {
        let Self { pools, shown: Shown { asked, .. }, .. } = self;
        // Answers come in the order of pictures: of those before there will be none any more.
        while asked.pop_front_if(|asked| asked.pictures.end <= picture).is_some() {}
        let Some(Asked { seen, pictures, .. }) = asked.front_mut().filter(|asked| asked.pictures.contains(&picture))
        else {
            return;
        };
        seen.iter_mut().zip(visibility).for_each(|(seen, by_eye)| seen.extend(by_eye));
        if picture + 1 < pictures.end {
            return;
        }
        let Some(Asked { drawn, seen, .. }) = asked.pop_front() else { return };
        for Pool { layers, pager, .. } in pools {
            for (volume, &layer) in layers.iter().enumerate() {
                // A scene that hides what the last step showed tells nothing of it.
                let drawn = drawn[layer].as_ref().filter(|drawn| drawn.entries() == seen[layer].len());
                drawn.iter().for_each(|drawn| pager.feedback(volume, drawn, &seen[layer]));
            }
        }
    }
}
