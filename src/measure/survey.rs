//! Measurement of settings of a scene on a device: cost, error, and causes of the error.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::sync::Arc;

use glam::DVec3;

use super::climb::{Climb, order};
use super::clock::Stopwatch;
use super::difference::{Difference, delta_e};
use super::enlarge::Enlargement;
use super::error::MeasureError;
use super::ladder::{Cause, Ladder, LadderError, Lattice};
use super::measured::{CloseUp, Cost, Frames, Measured, Run};
use super::setting::Setting;
use super::shown::{looked_up, picture};
use relume_base::number::count;
use relume_base::progress::{Progress, unreported};
use relume_render::{Renderer, SceneRenderer};
use relume_scene::plan::{Integrate, Planned, ScenePlan, plan};
use relume_scene::tables::TransferTable;
use relume_scene::{Accuracy, Coarse, Integration, Level, Mix, Scene};
use relume_volume::Statistics;
use relume_vulkan::DeviceKind;

/// Untimed runs before the timed ones.
const WARM_UP: usize = 2;
/// Consecutive timed runs when a setting is first measured; further runs take turns with all settings.
const AT_ONCE: usize = 3;

/// Extent of the measurement of every setting.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SurveyOptions {
    /// Pixels across and down of the timed pictures.
    pub size: [usize; 2],
    /// Maximum number of pixels in which errors are measured.
    pub pixels: usize,
    /// Timed runs, after two warm-up runs. The first three runs of a setting are consecutive; [`Survey::time_in_turn`]
    /// makes the others.
    pub runs: usize,
}

/// Pixels across and down of a close-up.
const CLOSE_UP: usize = 17;

/// A form of storage of a level of the volume on the device, and the times of its uploads.
struct Upload {
    plan: ScenePlan,
    level: u32,
    runs: Vec<Run>,
}

/// A measurement with all settings that share it, and its runs.
struct Known {
    same: Same,
    settings: Vec<Setting>,
    row: Measured,
    frames: Frames,
}

/// Measures settings of one scene on one device.
pub struct Survey<'a> {
    renderer: &'a Renderer,
    scene: &'a Scene,
    options: SurveyOptions,
    lattice: Lattice,
    /// Integration of the scene's own setting.
    integration: Integrate,
    ladder: Ladder<'a>,
    truth: Arc<Vec<DVec3>>,
    resident: Option<SceneRenderer>,
    uploads: Vec<Upload>,
    /// Coarser levels of the volume, by their numbers.
    levels: BTreeMap<u32, OfLevel>,
    /// Earlier measurements. A setting equivalent to a measured one shares its row: a second measurement would give
    /// another time.
    known: Vec<Known>,
}

/// A coarser level of the volume of the scene.
struct OfLevel {
    coarse: Coarse,
    statistics: Statistics,
}

/// Properties that equivalent settings share.
#[derive(PartialEq)]
struct Same {
    level: u32,
    plan: ScenePlan,
    carrier: String,
    /// Step length, termination, variation, scale, spacing of the light grid and directions of the sky, spacing and directions of scattered
    /// light.
    numbers: [f64; 8],
    /// Entries of the transfer table.
    entries: usize,
}

/// Representation of spectra, in words.
fn carrier(planned: &Planned) -> String {
    let weights = || format!("weights of {} components", planned.plan.components());
    planned.model.as_ref().map_or_else(weights, |model| model.description())
}

impl std::fmt::Debug for Survey<'_> {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        out.debug_struct("Survey").field("options", &self.options).finish_non_exhaustive()
    }
}

impl Upload {
    fn is_of(&self, plan: &ScenePlan, level: u32) -> bool {
        self.level == level && self.plan.is_stored_as(plan)
    }
}

/// Climbs the rungs from exact samples to stored tables in f32: all of them read the volume that the device marches.
fn lower(
    climb: &mut Climb,
    ladder: &mut Ladder<'_>,
    (scene, planned): (&Scene, &Planned),
    progress: &dyn Progress,
) -> Result<(), MeasureError> {
    if planned.plan.light.reads_grid() {
        let (_, scattering) = ladder.true_transport();
        climb.to(Cause::LightGrid, ladder.full(&scene.accuracy, &(scene.shadows, scattering), progress)?.to_vec());
    }
    if planned.plan.light.gathered.is_some() {
        let stated = (scene.shadows, scene.scattering);
        climb.to(Cause::Scattering, ladder.full(&scene.accuracy, &stated, progress)?.to_vec());
    }
    climb.to(Cause::Basis, ladder.model(scene, planned, progress)?);
    let stored = ladder.store(scene, planned);
    climb.to(Cause::Tables, ladder.stored::<f64>(scene, planned, &stored, progress)?);
    climb.to(Cause::Rounding, ladder.stored::<f32>(scene, planned, &stored, progress)?);
    Ok(())
}

impl<'a> Survey<'a> {
    /// Creates a survey of `scene` and computes the truth for the shortest step of `settings`.
    ///
    /// # Errors
    ///
    /// [`MeasureError`].
    pub fn new(
        renderer: &'a Renderer,
        scene: &'a Scene,
        settings: &[Setting],
        options: SurveyOptions,
        progress: &dyn Progress,
    ) -> Result<Self, MeasureError> {
        let lattice = Lattice::new(options.size, options.pixels);
        let applied = || settings.iter().map(|setting| setting.applied(scene).accuracy);
        let finest = applied().map(|accuracy| accuracy.step_length).fold(scene.accuracy.step_length, f64::min);
        let most_rays = applied().map(|accuracy| accuracy.rays).fold(scene.accuracy.rays, usize::max);
        let looked_at = lattice.pixels();
        let mut ladder =
            Ladder::new(scene, Mix::of_scene(scene), options.size, &looked_at, (finest, most_rays), progress)?;
        if ladder.pixels.is_empty() {
            return Err(MeasureError::Nothing { sampled: looked_at.len(), source_name: scene.name.clone() });
        }
        let truth = ladder.truth(progress)?;
        // A scene that cannot be planned has rows that say so.
        let integration =
            plan(scene, &unreported(progress)).map_or(Integrate::Samples, |planned| planned.plan.integration);
        Ok(Self {
            integration,
            renderer,
            scene,
            options,
            lattice,
            ladder,
            truth,
            resident: None,
            uploads: Vec::new(),
            levels: BTreeMap::new(),
            known: Vec::new(),
        })
    }

    /// The scene.
    #[must_use]
    pub fn scene(&self) -> &Scene {
        self.scene
    }

    /// The grid of examined pixels.
    #[must_use]
    pub fn lattice(&self) -> Lattice {
        self.lattice
    }

    /// The visible pixels of the grid, in which errors are measured.
    #[must_use]
    pub fn pixels(&self) -> &[[usize; 2]] {
        &self.ladder.pixels
    }

    /// The truth in [`Self::pixels`]: XYZ of the full spectrum, as displayed.
    #[must_use]
    pub fn truth(&self) -> &[DVec3] {
        &self.truth
    }

    /// Extent of the measurement of every setting.
    #[must_use]
    pub fn options(&self) -> SurveyOptions {
        self.options
    }

    /// XYZ behind the volume.
    #[must_use]
    pub fn background(&self) -> DVec3 {
        self.ladder.background
    }

    /// Whether the device is software on a CPU.
    #[must_use]
    pub fn is_software(&self) -> bool {
        self.renderer.device().info().kind == DeviceKind::Software
    }

    /// Name and driver of the device, in words.
    #[must_use]
    pub fn device(&self) -> String {
        let info = self.renderer.device().info();
        let software = if self.is_software() { ", a software device: times are this CPU's" } else { "" };
        format!("{} ({}){software}", info.name, info.driver)
    }

    /// Measures `setting`.
    ///
    /// # Errors
    ///
    /// [`MeasureError`].
    pub fn measure(&mut self, setting: &Setting, progress: &dyn Progress) -> Result<Measured, MeasureError> {
        let progress = &unreported(progress);
        let stated = setting.applied(self.scene);
        let asked = (stated.accuracy.voxel_pixels > 0.0).then(|| stated.level(self.options.size));
        let (scene, level) = self.at_level(&stated, progress)?;
        let planned = plan(&scene, progress)?;
        let on_device = self.upload(scene, level, planned, WARM_UP, progress)?;
        let (scene, planned, uploaded) = (on_device.scene(), on_device.planned(), on_device.uploaded());
        let integration = planned.plan.integration;
        let other_integration = stated.accuracy.integration == Integration::Auto && integration != self.integration;
        let size = setting.marched_size(self.options.size);
        let table = TransferTable::new(scene, planned, &uploaded.domains());
        let same = Same {
            level,
            plan: planned.plan.clone(),
            carrier: carrier(planned),
            numbers: [
                scene.accuracy.step_length,
                scene.accuracy.termination,
                scene.accuracy.variation,
                setting.scale(),
                scene.shadows.spacing,
                count(scene.shadows.directions),
                scene.scattering_spacing(),
                count(scene.scattering_directions()),
            ],
            entries: table.entries(),
        };
        if let Some(known) = self.known.iter_mut().find(|known| known.same == same) {
            known.settings.push(setting.clone());
            return Ok(Measured { setting: setting.clone(), level: asked, other_integration, ..known.row.clone() });
        }
        let volume_bytes = uploaded.bytes();
        let mut warm_up = Frames::default();
        for _ in 0..WARM_UP {
            self.frame(&on_device, size, &mut warm_up, progress)?;
        }
        let mut frames = Frames::default();
        for _ in 0..self.options.runs.min(AT_ONCE) {
            self.frame(&on_device, size, &mut frames, progress)?;
        }
        let of_size = |size| picture(&self.ladder, &on_device, size, progress);
        let whole_size = of_size(self.options.size)?;
        let enlargement = Enlargement::new(size, self.options.size);
        let enlarged = if enlargement.is_none() { None } else { Some(enlargement.pixels(&of_size(size)?)) };
        let dispatches = frames.dispatches;
        let upload = self.uploads.iter().find(|upload| upload.is_of(&planned.plan, level));
        let times = frames.times(upload.map_or_else(|| Cost::of(&[]), |upload| Cost::of(&upload.runs)));

        let truth = Arc::clone(&self.truth);
        let mut climb = Climb::from(truth.to_vec(), self.ladder.pixels.clone());
        let accuracy = &stated.accuracy;
        let stated = (self.scene.accuracy.interpolation, self.scene.accuracy.labels);
        let of_step = |step_length: f64| {
            let (interpolation, labels) = stated;
            Accuracy { step_length, termination: 0.0, interpolation, labels, ..accuracy.clone() }
        };
        let rays = self.ladder.true_transport();
        let mut of_rays = Arc::clone(&truth);
        if accuracy.rays < self.ladder.rays {
            let fewer = Accuracy { rays: accuracy.rays, ..self.ladder.true_accuracy() };
            of_rays = self.ladder.full(&fewer, &rays, progress)?;
            climb.to(Cause::PixelArea, of_rays.to_vec());
        }
        let stepped = self.ladder.full(&of_step(accuracy.step_length), &rays, progress)?;
        let halved = self.ladder.full(&of_step(accuracy.step_length / 2.0), &rays, progress)?;
        let order = order(&delta_e(&stepped, &of_rays), &delta_e(&halved, &of_rays));
        climb.to(Cause::Step, stepped.to_vec());
        if (accuracy.interpolation, accuracy.labels) != stated {
            let other = self.ladder.full(&Accuracy { termination: 0.0, ..accuracy.clone() }, &rays, progress)?;
            climb.to(Cause::Interpolation, other.to_vec());
        }
        climb.to(Cause::Termination, self.ladder.full(accuracy, &rays, progress)?.to_vec());
        if level == 0 {
            lower(&mut climb, &mut self.ladder, (scene, planned), progress)?;
        } else {
            let mut ladder = self.ladder.of_level(scene)?;
            let rays = ladder.true_transport();
            climb.to(Cause::Level, ladder.full(&scene.accuracy, &rays, progress)?.to_vec());
            lower(&mut climb, &mut ladder, (scene, planned), progress)?;
        }
        climb.to(Cause::Device, looked_up(&whole_size, self.options.size, &self.ladder.pixels));
        if let Some(enlarged) = enlarged {
            climb.to(Cause::Resolution, looked_up(&enlarged, self.options.size, &self.ladder.pixels));
        }
        let error = Difference::between(&climb.last, &truth, &self.ladder.pixels);
        let worst_by = error.at.map_or_else(Vec::new, |at| climb.at(at));
        let colours = climb.last;
        let plan = &planned.plan;
        let tables = size_of_val(table.source.as_slice()) + size_of_val(table.opacity.as_slice());
        let row = Measured {
            setting: setting.clone(),
            level: asked,
            integration,
            other_integration,
            carrier: same.carrier.clone(),
            components: plan.components(),
            frame_ms: times.frame_ms(),
            times,
            dispatches,
            pixel_bytes: plan.pixel_bytes(),
            volume_bytes,
            total_bytes: volume_bytes + tables as u64 + (size[0] * size[1]) as u64 * plan.marched_bytes(),
            error,
            causes: climb.causes,
            worst_by,
            order,
            pareto: false,
            differences: delta_e(&colours, &truth),
            colours,
        };
        self.known.push(Known { same, settings: vec![setting.clone()], row: row.clone(), frames });
        Ok(row)
    }

    /// Times all measured settings in turn until each has the requested number of runs, so that other programs slow
    /// all settings alike. Updates `rows` to the times of all runs.
    ///
    /// # Errors
    ///
    /// [`MeasureError`]; `rows` then have the times of the completed turns.
    pub fn time_in_turn(&mut self, rows: &mut [Measured], progress: &dyn Progress) -> Result<(), MeasureError> {
        // Groups settings by form of storage, so that each volume is uploaded once per turn.
        let mut order: Vec<usize> = (0..self.known.len()).collect();
        let stored = |index: &usize| {
            let Same { plan, level, .. } = &self.known[*index].same;
            self.uploads.iter().position(|upload| upload.is_of(plan, *level))
        };
        order.sort_by_key(stored);
        let total = self.options.runs.saturating_sub(AT_ONCE);
        for turn in 0..total {
            for (done, &index) in order.iter().enumerate() {
                let stage = format!("timing all settings in turn, {} of {total}", turn + 1);
                progress.report(&stage, done as u64, order.len() as u64);
                self.time_once_more(index, &unreported(progress))?;
            }
            self.write_times(rows);
        }
        Ok(())
    }

    /// Times one more frame of a measured setting.
    fn time_once_more(&mut self, index: usize, progress: &dyn Progress) -> Result<(), MeasureError> {
        let setting = self.known[index].row.setting.clone();
        let (scene, level) = self.at_level(&setting.applied(self.scene), progress)?;
        let planned = plan(&scene, progress)?;
        let on_device = self.upload(scene, level, planned, 0, progress)?;
        let size = setting.marched_size(self.options.size);
        let light = &on_device.planned().plan.light;
        if light.reads_grid() || light.gathered.is_some() {
            // Settings share a volume, and so one light grid and one scattered light; those of another setting may have replaced them.
            on_device.march(size, progress)?;
        }
        let fills = self.renderer.light_fills();
        let mut frames = std::mem::take(&mut self.known[index].frames);
        let timed = self.frame(&on_device, size, &mut frames, progress);
        self.known[index].frames = frames;
        debug_assert_eq!(self.renderer.light_fills(), fills, "a timed frame reads a complete light grid");
        timed
    }

    /// Updates `rows` to the times of all runs so far.
    fn write_times(&mut self, rows: &mut [Measured]) {
        for known in &mut self.known {
            let upload = self.uploads.iter().find(|upload| upload.is_of(&known.same.plan, known.same.level));
            let times = known.frames.times(upload.map_or(known.row.times.upload, |upload| Cost::of(&upload.runs)));
            known.row = Measured { frame_ms: times.frame_ms(), times, ..known.row.clone() };
            for row in rows.iter_mut().filter(|row| known.settings.contains(&row.setting)) {
                (row.frame_ms, row.times) = (known.row.frame_ms, known.row.times.clone());
            }
        }
    }

    /// Neighbourhood of the worst pixel of `row`; `None` if it has no error.
    ///
    /// # Errors
    ///
    /// [`MeasureError`].
    pub fn close_up(&mut self, row: &Measured, progress: &dyn Progress) -> Result<Option<CloseUp>, MeasureError> {
        let Some(worst) = row.error.at else { return Ok(None) };
        let progress = &unreported(progress);
        let side = CLOSE_UP.min(self.options.size[0]).min(self.options.size[1]);
        let first: [usize; 2] =
            std::array::from_fn(|axis| worst[axis].saturating_sub(side / 2).min(self.options.size[axis] - side));
        let pixels: Vec<[usize; 2]> = (0..side * side).map(|i| [first[0] + i % side, first[1] + i / side]).collect();
        let (scene, level) = self.at_level(&row.setting.applied(self.scene), progress)?;
        let planned = plan(&scene, progress)?;
        let on_device = self.upload(scene, level, planned, 0, progress)?;
        let size = row.setting.marched_size(self.options.size);
        let marched = picture(&self.ladder, &on_device, size, progress)?;
        let [across, down] = self.options.size;
        let marched = Enlargement::new(size, self.options.size).pixels(&marched);
        let all: Vec<[usize; 2]> = (0..across * down).map(|i| [i % across, i / across]).collect();
        let [shown, whole] = [&pixels, &all].map(|pixels| looked_up(&marched, self.options.size, pixels));
        let truth = self.ladder.truth_in(&pixels, progress)?;
        Ok(Some(CloseUp { side, first, differences: delta_e(&shown, &truth), shown, truth, whole }))
    }

    /// `stated` with the level of its volume that it asks for, and the number of this level.
    fn at_level(&mut self, stated: &Scene, progress: &dyn Progress) -> Result<(Scene, u32), MeasureError> {
        let Level { level, .. } = stated.level(self.options.size);
        if level == 0 {
            return Ok((stated.clone(), 0));
        }
        let OfLevel { coarse, .. } = match self.levels.entry(level) {
            Entry::Occupied(known) => known.into_mut(),
            Entry::Vacant(new) => {
                let coarse = Coarse::of_level(self.scene, level, progress).map_err(LadderError::from)?;
                let statistics = coarse.volume().statistics().map_err(LadderError::from)?;
                new.insert(OfLevel { coarse, statistics })
            }
        };
        Ok((coarse.scene_in(stated, self.options.size), level))
    }

    /// Uploads the volume as `planned` needs it, unless it is resident. A new form of storage is first uploaded
    /// `warm_up` times without timing.
    fn upload(
        &mut self,
        scene: Scene,
        level: u32,
        planned: Planned,
        warm_up: usize,
        progress: &dyn Progress,
    ) -> Result<SceneRenderer, MeasureError> {
        if let Some(resident) = self.resident.as_ref().filter(|resident| resident.holds(&scene, &planned)) {
            return Ok(resident.with_scene(scene, planned, progress)?);
        }
        let known = self.uploads.iter().position(|upload| upload.is_of(&planned.plan, level));
        let index = known.unwrap_or_else(|| {
            self.uploads.push(Upload { plan: planned.plan.clone(), level, runs: Vec::new() });
            self.uploads.len() - 1
        });
        let warm_up = if known.is_some() { 0 } else { warm_up };
        let statistics = self.levels.get(&level).map_or_else(|| self.ladder.statistics(), |level| &level.statistics);
        let statistics = statistics.clone();
        let mut uploaded = |warm_up: bool| {
            self.resident = None;
            let (scene, planned, statistics) = (scene.clone(), planned.clone(), statistics.clone());
            let clock = Stopwatch::start();
            let resident = SceneRenderer::with_plan(self.renderer, scene, planned, statistics, progress)?;
            if !warm_up {
                self.uploads[index].runs.push((clock.read(), None));
            }
            self.resident = Some(resident.clone());
            Ok(resident)
        };
        for _ in 0..warm_up {
            uploaded(true)?;
        }
        uploaded(false)
    }

    /// Renders and times a frame of `size`.
    fn frame(
        &self,
        on_device: &SceneRenderer,
        size: [usize; 2],
        frames: &mut Frames,
        progress: &dyn Progress,
    ) -> Result<(), MeasureError> {
        let matrices = self.ladder.shown(on_device.scene(), on_device.planned());
        let clock = Stopwatch::start();
        let accumulators = on_device.march(size, progress)?;
        let march = (clock.read(), accumulators.device_time);
        let relight = self.renderer.relight_display(&accumulators)?;
        let clock = Stopwatch::start();
        let took = relight.run(&matrices)?;
        let relit = (clock.read(), took);
        let clock = Stopwatch::start();
        let picture: Vec<[u8; 4]> = relight.read()?;
        let read_back = (clock.read(), None);
        let enlargement = Enlargement::new(size, self.options.size);
        if !enlargement.is_none() {
            let shown = &picture;
            let linear: Vec<[f32; 4]> = shown.iter().map(|pixel| pixel.map(f32::from)).collect();
            let clock = Stopwatch::start();
            let _enlarged = enlargement.pixels(&linear);
            frames.enlarges.push((clock.read(), None));
        }
        frames.dispatches = accumulators.dispatches;
        frames.marches.push(march);
        frames.relights.push(relit);
        frames.read_backs.push(read_back);
        Ok(())
    }
}
