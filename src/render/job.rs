//! From a scene to its films: the level of its volume, its plan, and its march on a device or by the reference.

use std::ptr;
use std::sync::{Arc, Weak};

use glam::DVec3;

use super::{DeviceFilm, RenderError, Renderer, SceneRenderer};
use relume_base::progress::{Progress, unreported};
use relume_colour::spectrum::Light;
use relume_scene::film::{Film, RelightMatrices};
use relume_scene::plan::{PlanError, Planned, plan_for, plan_full_spectrum};
use relume_scene::reference::{Exact, ReferenceError, Skipping, Stored, march, render};
use relume_scene::tables::{
    Cells, LabelMap, Occupancy, PlacedField, Storage, StoredScene, StoredVolume, occupancy_of_fields, reach_in_voxels,
};
use relume_scene::{AccumulateAs, Camera, Coarse, LabelLeft, Level, Mix, Scene};
use relume_volume::{Statistics, Volume};

/// Contents of a pixel of a film.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Keeps {
    /// Those that the scene states.
    #[default]
    Stated,
    /// Weights of the materials where absorption is grey, light scatters once and the scene states nothing else: exact under every light.
    Weights,
    /// All bands of each light position. The reference alone marches them.
    Bands,
}

/// A scene to be rendered, before it is planned. Commands, pages and the window plan by it.
#[derive(Clone, Debug)]
pub struct Job {
    /// The scene.
    pub scene: Scene,
    /// Statistics of its volume's values.
    pub statistics: Statistics,
    /// Size (width, height) and cameras of the pictures, by which [`voxel_pixels`](relume_scene::Accuracy::voxel_pixels)
    /// chooses a level; without one, the voxels themselves are marched.
    pub pictures: Option<([usize; 2], Vec<Camera>)>,
    /// Lights, by name, for which a colour model is planned besides those of the scene.
    pub lights: Vec<(String, Light)>,
    /// Contents of a pixel.
    pub keeps: Keeps,
}

/// The level of its volume that a scene asks for.
#[derive(Clone, Debug)]
pub struct PictureLevel {
    /// The level and its reason; 0 is the volume itself.
    pub level: Level,
    /// Visible labels with their voxels in it, the label with the fewest first.
    pub labels: Vec<LabelLeft>,
}

/// A [`Job`] whose level is taken and whose plan is made.
#[derive(Clone, Debug)]
pub struct PlannedJob {
    /// The scene, on its level.
    pub scene: Scene,
    /// Its plan.
    pub planned: Planned,
    /// Statistics of the values of its voxels.
    pub statistics: Statistics,
    /// The level, if the scene asks for one.
    pub level: Option<PictureLevel>,
    /// Cameras of the pictures, in the world of `scene`.
    pub cameras: Vec<Camera>,
}

impl Job {
    /// The job of `scene`, whose values have `statistics`: its voxels themselves, its lights, what it states.
    #[must_use]
    pub const fn new(scene: Scene, statistics: Statistics) -> Self {
        Self { scene, statistics, pictures: None, lights: Vec::new(), keeps: Keeps::Stated }
    }

    /// The same for pictures of `size` by these `cameras`.
    #[must_use]
    pub fn of_pictures(self, size: [usize; 2], cameras: Vec<Camera>) -> Self {
        Self { pictures: Some((size, cameras)), ..self }
    }

    /// Takes the level of the volume and plans the scene.
    ///
    /// # Errors
    ///
    /// [`RenderError::Volume`], [`RenderError::Plan`], [`RenderError::Cancelled`].
    pub fn planned(self, progress: &dyn Progress) -> Result<PlannedJob, RenderError> {
        let Self { scene, statistics, pictures, lights, keeps } = self;
        let level = pictures.as_ref().filter(|_| scene.accuracy.voxel_pixels > 0.0);
        let level = level.map(|(size, cameras)| scene.level_of(cameras, *size));
        let (size, mut cameras) = pictures.unwrap_or_else(|| ([0; 2], vec![scene.camera.clone()]));
        let (mut scene, statistics, level) = match level {
            Some(level) if level.level > 0 => {
                let coarse = Coarse::of_level(&scene, level.level, progress).map_err(RenderError::Volume)?;
                let labels = coarse.labels_left(&scene).map_err(RenderError::Volume)?;
                let statistics = coarse.volume().statistics().map_err(RenderError::Volume)?;
                cameras = cameras.iter().map(|camera| Coarse::camera_in(&scene, camera, size)).collect();
                (coarse.scene_in(&scene, size), statistics, Some(PictureLevel { level, labels }))
            }
            level => (scene, statistics, level.map(|level| PictureLevel { level, labels: Vec::new() })),
        };
        let planned = match keeps {
            Keeps::Stated => plan_for(&scene, &lights, progress)?,
            Keeps::Weights => of_weights(&mut scene, &lights, progress)?,
            Keeps::Bands => {
                // A plan refuses features that no renderer has, such as coloured shadows by rays, or labels of the largest value.
                if scene.asks_for_shadows() || scene.blending.is_extreme() {
                    plan_for(&scene, &[], progress)?;
                }
                plan_full_spectrum(&scene)
            }
        };
        Ok(PlannedJob { scene, planned, statistics, level, cameras })
    }
}

/// The plan of `scene` with weights of materials, and otherwise as it states.
fn of_weights(scene: &mut Scene, lights: &[(String, Light)], progress: &dyn Progress) -> Result<Planned, PlanError> {
    let accuracy = &scene.accuracy;
    if accuracy.accumulate == AccumulateAs::Auto && accuracy.dimension.is_none() {
        scene.accuracy.accumulate = AccumulateAs::Weights;
        match plan_for(scene, lights, progress) {
            Err(PlanError::NotGrey { .. } | PlanError::NoScattering { .. }) => {
                scene.accuracy.accumulate = AccumulateAs::Auto;
            }
            planned => return planned,
        }
    }
    plan_for(scene, lights, progress)
}

impl PlannedJob {
    /// The job of `scene` by itself, which is `planned` already.
    #[must_use]
    pub fn new(scene: Scene, planned: Planned, statistics: Statistics) -> Self {
        let cameras = vec![scene.camera.clone()];
        Self { scene, planned, statistics, level: None, cameras }
    }

    /// Uploads the volume to the device of `renderer`.
    ///
    /// # Errors
    ///
    /// [`RenderError`].
    pub fn uploaded(&self, renderer: &Renderer, progress: &dyn Progress) -> Result<SceneRenderer, RenderError> {
        let Self { scene, planned, statistics, .. } = self.clone();
        SceneRenderer::with_plan(renderer, scene, planned, statistics, progress)
    }

    /// Puts the scene in place of what is `kept` on the device, and uploads its volume only if it is not there. If there is too
    /// little room for it, what was kept stays; after another error of the upload, nothing is kept.
    ///
    /// # Errors
    ///
    /// [`RenderError`].
    pub fn put(
        self,
        kept: &mut Option<SceneRenderer>,
        renderer: &Renderer,
        progress: &dyn Progress,
    ) -> Result<(), RenderError> {
        let Self { scene, planned, statistics, .. } = self;
        let held = kept.as_ref().filter(|before| before.holds(&scene, &planned));
        let made = if let Some(before) = held {
            before.with_scene(scene, planned, progress)?
        } else {
            renderer.check_room(&scene, &planned, &statistics)?;
            // There may be no room for two volumes.
            *kept = None;
            SceneRenderer::with_plan(renderer, scene, planned, statistics, progress)?
        };
        *kept = Some(made);
        Ok(())
    }

    /// Films of `size` by all cameras, one after the other; `seen` gets each before it is read.
    ///
    /// # Errors
    ///
    /// [`RenderError`].
    pub fn films(
        &self,
        on_device: &mut SceneRenderer,
        size: [usize; 2],
        progress: &dyn Progress,
        mut seen: impl FnMut(&SceneRenderer, &DeviceFilm),
    ) -> Result<Vec<Film<f32>>, RenderError> {
        let number = self.cameras.len() as u64;
        let mut films = Vec::new();
        for (index, camera) in self.cameras.iter().enumerate() {
            on_device.camera_mut().clone_from(camera);
            let film = if number > 1 {
                progress.report("marching", index as u64, number);
                on_device.march(size, &unreported(progress))?
            } else {
                on_device.march(size, progress)?
            };
            seen(on_device, &film);
            films.push(on_device.renderer().read(&film)?);
        }
        Ok(films)
    }

    /// The scene without a device, in f32 on stored tables as on a device: all that it marches is ready. What is `kept` of a volume is
    /// taken if it is that of this scene, and otherwise replaced.
    ///
    /// # Errors
    ///
    /// [`RenderError::Labels`].
    pub fn on_cpu(&self, kept: &mut Option<KeptVolume>) -> Result<OnCpu<'_>, RenderError> {
        let Self { scene, planned, statistics, .. } = self;
        scene.volume().require_voxels("a march without a device").map_err(RenderError::Volume)?;
        let storage = Storage::new(&planned.plan, scene.volume(), statistics);
        let labels = scene.labels.as_ref().filter(|_| planned.plan.labels).map(LabelMap::new).transpose();
        let labels = labels.map_err(RenderError::Labels)?.map(Arc::new);
        let volume = &scene.fields.first().volume;
        let is_of = |kept: &&mut KeptVolume| ptr::eq(kept.of.as_ptr(), &raw const **volume) && kept.storage == storage;
        let stored = match kept.as_mut().filter(is_of) {
            Some(kept) => Arc::clone(&kept.stored),
            None => {
                // There may be no room for two.
                *kept = None;
                let stored = Arc::new(StoredVolume::new(volume, &storage));
                let of = Arc::downgrade(volume);
                *kept = Some(KeptVolume { of, storage: storage.clone(), stored: Arc::clone(&stored) });
                stored
            }
        };
        let cells = Cells::new(volume, &storage, labels.as_deref());
        let stored = StoredScene::of(scene, planned, (storage, stored), labels);
        let reach = reach_in_voxels(scene, &planned.plan);
        let occupancy = match &stored.segments {
            None if planned.plan.groups.further > 0 => {
                let further = scene.fields.further().iter().zip(&stored.further);
                let further: Vec<Cells> =
                    further.map(|(field, (storage, ..))| Cells::new(&field.volume, storage, None)).collect();
                let places: Vec<Option<PlacedField>> = stored.further.iter().map(|field| field.2).collect();
                occupancy_of_fields(
                    &std::iter::once(&cells).chain(&further).collect::<Vec<_>>(),
                    &places,
                    &stored.table,
                )
            }
            None => cells.occupancy_within(scene, reach, &stored.table.active_entries()),
            Some(table) => cells.occupancy_within(scene, reach, &table.active_entries()),
        };
        Ok(OnCpu { job: self, stored, occupancy })
    }

    /// The scene without a device, in f64.
    ///
    /// # Errors
    ///
    /// [`RenderError::Labels`].
    pub fn reference(&self) -> Result<Reference<'_>, RenderError> {
        let Self { scene, planned, statistics, .. } = self;
        let storage = Storage::new(&planned.plan, scene.volume(), statistics);
        let labels = scene.labels.as_ref().filter(|_| planned.plan.labels).map(LabelMap::new).transpose();
        Ok(Reference { job: self, storage, labels: labels.map_err(RenderError::Labels)? })
    }
}

/// A volume as a device would store it, for marches without one.
#[derive(Debug)]
pub struct KeptVolume {
    /// The volume; while this is known, no other one has its place in memory.
    of: Weak<Volume>,
    storage: Storage,
    stored: Arc<StoredVolume>,
}

/// A scene that the reference marches on all cores, in f32 on stored tables. Its film is that of a device within
/// rounding.
#[derive(Debug)]
pub struct OnCpu<'a> {
    job: &'a PlannedJob,
    /// The tables and the volume.
    pub stored: StoredScene,
    occupancy: Occupancy,
}

impl OnCpu<'_> {
    /// The film of `size` by `camera`.
    ///
    /// # Errors
    ///
    /// [`ReferenceError`].
    pub fn film(
        &self,
        camera: &Camera,
        size: [usize; 2],
        progress: &dyn Progress,
    ) -> Result<Film<f32>, ReferenceError> {
        let scene = Scene { camera: camera.clone(), ..self.job.scene.clone() };
        let planned = &self.job.planned;
        let stored = Stored::<f32>::new(planned, &self.stored);
        if planned.plan.skipping {
            let stored = Skipping::new(stored, &self.occupancy, &scene, planned).of_tables();
            march(&scene, planned, &stored, size, progress)
        } else {
            march(&scene, planned, &stored, size, progress)
        }
    }
}

/// A scene that the reference marches on all cores, in f64 and without tables.
#[derive(Debug)]
pub struct Reference<'a> {
    job: &'a PlannedJob,
    /// The volume as a device would store it.
    pub storage: Storage,
    /// Labels, if the plan has any.
    pub labels: Option<LabelMap>,
}

impl Reference<'_> {
    /// The film of the job's own plan.
    ///
    /// # Errors
    ///
    /// [`ReferenceError`].
    pub fn film(&self, size: [usize; 2], progress: &dyn Progress) -> Result<Film<f64>, ReferenceError> {
        self.march(&self.job.planned, size, progress)
    }

    /// The film of all bands.
    ///
    /// # Errors
    ///
    /// [`ReferenceError`].
    pub fn bands(&self, size: [usize; 2], progress: &dyn Progress) -> Result<Film<f64>, ReferenceError> {
        self.march(&plan_full_spectrum(&self.job.scene), size, progress)
    }

    /// Linear sRGB and opacity of every pixel under `mix`, from all bands, none of which is kept.
    ///
    /// # Errors
    ///
    /// [`ReferenceError`].
    pub fn picture(
        &self,
        mix: &Mix,
        size: [usize; 2],
        progress: &dyn Progress,
    ) -> Result<Vec<(DVec3, f64)>, ReferenceError> {
        let (scene, truth) = (&self.job.scene, plan_full_spectrum(&self.job.scene));
        let matrices = RelightMatrices::of_scene(scene, &truth, mix);
        render(scene, &truth, &self.exact(&truth), &matrices, size, progress)
    }

    fn march(&self, planned: &Planned, size: [usize; 2], progress: &dyn Progress) -> Result<Film<f64>, ReferenceError> {
        march::<f64>(&self.job.scene, planned, &self.exact(planned), size, progress)
    }

    fn exact<'b>(&'b self, planned: &'b Planned) -> Exact<'b> {
        Exact::new(&self.job.scene, planned, self.storage.clone(), self.labels.as_ref())
    }
}
