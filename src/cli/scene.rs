//! Scenes, volumes and lights as command-line arguments.

use std::path::{Path, PathBuf};

use clap::Args;

use crate::document::{self, design, import};
use crate::document::{
    Definition, LightRequest, Look, Placed, Quality, Requested, SceneFile, SceneOptions, Shares, Source, Wish,
};
use crate::number::brief;
use crate::progress::Progress;
use crate::scene::{FIELDS, Mix, Scene};
use crate::spectrum::Spectrum;
use crate::volume::{ByteOrder, HostMemory, RawLayout, Selection, Statistics, Unit, Volume, VoxelType};

use super::CliError;
use super::accuracy::AccuracyArgs;

/// A scene and its changes.
#[derive(Debug, Args)]
pub(crate) struct SceneArgs {
    /// Scene file (TOML; its keys are in docs/SCENE.md), or a volume: a file or a folder of any format of docs/FORMATS.md.
    /// Default: the built-in scene.
    #[arg(index = 1)]
    pub(crate) scene: Option<PathBuf>,
    /// Further volumes, up to 3, beside a volume: each on its own grid, where it is in the world, as a material that glows and hides
    /// nothing, such as PET over CT. Scenes state them in [volumes].
    #[arg(index = 2, value_name = "VOLUME")]
    beside: Vec<PathBuf>,
    /// Volume in place of that of the scene: any format of docs/FORMATS.md, .raw (see below), or a .toml sidecar of a
    /// .raw. Without a scene, Relume makes one from the values.
    #[arg(long, value_name = "FILE")]
    pub(crate) volume: Option<PathBuf>,
    /// Label map on the grid of the volume, in place of that of the scene. [labels] in the scene defines the appearance of
    /// the labels.
    #[arg(long, value_name = "FILE")]
    pub(crate) labels: Option<PathBuf>,
    /// Names and colours of labels: a table of ITK-SNAP (.txt, .label), 3D Slicer (.ctbl) or FreeSurfer, a CSV, or freesurfer or
    /// totalsegmentator for their own numbering.
    #[arg(long, value_name = "FILE|NAME")]
    pub(crate) label_names: Option<PathBuf>,
    /// Show these channels of a volume of several together, by name or number, separated by commas: each is a material, and a light of its
    /// name shows it alone. Default: all, up to four.
    #[arg(long, value_name = "NAMES", conflicts_with = "component")]
    pub(crate) channels: Option<String>,
    /// Cut away what lies beyond a plane (repeatable, up to 8): z:50% leaves the lower half, -x:12 cuts what is below 12 along x,
    /// 1,0,1:5,0,5 what is beyond a point in a direction, left:40% of a patient all but 40 % from the right. In place of the planes
    /// of the scene.
    #[arg(long, value_name = "DIRECTION:PLACE", allow_hyphen_values = true)]
    clip: Vec<String>,
    /// Show other values: stretch what a field shows to those from LOW to HIGH, as contrast limits do (repeatable): of the volume, or of a
    /// channel or further volume by its name.
    #[arg(long, value_name = "[NAME=]LOW:HIGH", allow_hyphen_values = true, value_parser = range)]
    range: Vec<Definition>,
    /// Hide these fields of several, by name, separated by commas: volumes or channels that show nothing, and hide nothing.
    #[arg(long, value_name = "NAMES")]
    hide: Option<String>,
    /// Show a field only where something else is: inside labels of a label map, --mask pet=organs.nrrd:1,2, or where another field has at least
    /// a value, --mask spots=nuclei:30000. With ! before it, --mask 'pet=!organs.nrrd:1', only elsewhere.
    #[arg(long, value_name = "NAME=[!]WHAT:NUMBERS", value_parser = mask)]
    mask: Option<Mask>,
    /// Crop to a box: LOW:HIGH along x, y and z, in voxel indices or parts of the volume: 25%:75%,0:100,50%:100%.
    #[arg(long, value_name = "X,Y,Z", value_parser = crop)]
    crop: Option<Definition>,
    /// Average blocks of A×B×C voxels after loading, for less memory and time but less detail.
    #[arg(long, value_name = "AxBxC", value_parser = three)]
    pub(crate) downsample: Option<[usize; 3]>,
    /// Samples, rays, shadows and sky in one word. draft: one sample a step, no shadows. good: further samples where two differ,
    /// shadows of all lights and of the sky on a grid of 4 voxels; one and a half to twice the time of draft. best: four rays a
    /// pixel and a grid of 2 voxels; three to six times. -D changes single keys of it.
    #[arg(long, value_name = "draft|good|best", value_parser = Quality::of)]
    quality: Option<Quality>,
    #[command(flatten)]
    pub(crate) define: DefineArgs,
    #[command(flatten)]
    pub(crate) accuracy: AccuracyArgs,
    #[command(flatten)]
    pub(crate) selection: SelectionArgs,
    #[command(flatten)]
    pub(crate) raw: RawArgs,
}

/// The flag `-D`.
#[derive(Debug, Args)]
pub(crate) struct DefineArgs {
    /// Change a value of the scene file, or add one (repeatable), for example -D lights.key.intensity=2 or -D
    /// transfer.intervals.bone.opacity=0.5. * stands for each: -D 'lights.*.shadows=true'.
    #[arg(short = 'D', long = "define", value_name = "KEY=VALUE")]
    define: Vec<String>,
}

impl DefineArgs {
    pub(crate) fn is_empty(&self) -> bool {
        self.define.is_empty()
    }

    pub(crate) fn definitions(&self) -> impl Iterator<Item = Definition> {
        self.define.iter().map(|text| Definition { given: format!("-D {text}"), text: text.clone() })
    }
}

/// Heading in `--help`.
const SEVERAL: &str = "Volumes with several components, time steps, arrays, series or levels, or with sheared axes";

/// Choice of one volume from a file with several.
#[derive(Debug, Args)]
pub(crate) struct SelectionArgs {
    /// Read this component of every voxel, counted from 0: a colour channel, an entry of a vector or a tensor.
    #[arg(long, help_heading = SEVERAL, value_name = "N", value_parser = component_number)]
    component: Option<usize>,
    /// Read this time step, counted from 0.
    #[arg(long, help_heading = SEVERAL, value_name = "N", value_parser = time_step)]
    time: Option<usize>,
    /// Read the array of this name.
    #[arg(long, help_heading = SEVERAL, value_name = "NAME")]
    array: Option<String>,
    /// Read the series of this number: one of a folder of DICOM files (or by its UID), an image of an OME-TIFF file, or a
    /// run of slices of a folder.
    #[arg(long, help_heading = SEVERAL, value_name = "N|UID")]
    series: Option<String>,
    /// Read this level of resolution of a pyramid; 0 is the finest, and the default. Of a Zarr store, the default is the
    /// finest that fits the memory.
    #[arg(long, help_heading = SEVERAL, value_name = "N")]
    pyramid_level: Option<usize>,
    /// Axes of an array (.npy, Zarr, HDF5) that does not name them, slowest first, such as czyx: x, y, z, c (component) and
    /// t (time).
    #[arg(long, help_heading = SEVERAL, value_name = "LETTERS")]
    axes: Option<String>,
    /// Resample a sheared volume (as after gantry tilt) to an orthogonal grid: values trilinearly, labels by the nearest
    /// voxel. Without this flag, Relume refuses such a volume.
    #[arg(long, help_heading = SEVERAL)]
    resample: bool,
}

/// The value of `--time` that stands for all time steps; no file has as many.
const ALL_TIMES: usize = usize::MAX;

/// Parses the number of a time step.
fn time_step(text: &str) -> Result<usize, String> {
    match text.parse() {
        _ if text == "all" => Err("only `relume render` takes all time steps; write a number".into()),
        Ok(time) if time < ALL_TIMES => Ok(time),
        _ => Err("write the number of a time step, from 0 on; relume info FILE lists them".to_owned()),
    }
}

/// The same, or `all`.
pub(crate) fn time_or_all(text: &str) -> Result<usize, String> {
    if text == "all" { Ok(ALL_TIMES) } else { time_step(text).map_err(|error| error + "; or write all") }
}

impl SelectionArgs {
    pub(crate) fn selection(&self) -> Selection {
        Selection {
            component: self.component,
            time: self.time,
            array: self.array.clone(),
            series: self.series.clone(),
            level: self.pyramid_level,
            axes: self.axes.clone(),
            resample: self.resample,
            ..Selection::default()
        }
    }

    /// Flags that choose a part of a file, and whether each is given.
    pub(crate) fn choices(&self) -> [(&'static str, bool); 7] {
        [
            ("--component", self.component.is_some()),
            ("--time", self.time.is_some()),
            ("--array", self.array.is_some()),
            ("--series", self.series.is_some()),
            ("--pyramid-level", self.pyramid_level.is_some()),
            ("--axes", self.axes.is_some()),
            ("--resample", self.resample),
        ]
    }
}

/// Heading in `--help`. `next_help_heading` would also apply to all later arguments.
const RAW: &str = "Volumes without a header (FILE.raw)";

/// Layout of a headerless volume in its file.
#[derive(Debug, Args)]
pub(crate) struct RawArgs {
    /// Voxels along x, y and z, x fastest.
    #[arg(long, help_heading = RAW, value_name = "NXxNYxNZ", value_parser = three, requires = "voxel_type")]
    dims: Option<[usize; 3]>,
    /// Type of a voxel: uint8, int8, uint16, int16, uint32, int32, uint64, int64, float32 or float64.
    #[arg(long = "type", help_heading = RAW, value_name = "TYPE", requires = "dims")]
    voxel_type: Option<VoxelType>,
    /// The most significant byte of a voxel comes first.
    #[arg(long, help_heading = RAW, requires = "dims")]
    big_endian: bool,
    /// Bytes to skip at the beginning of the file.
    #[arg(long, help_heading = RAW, value_name = "BYTES", default_value_t = 0, requires = "dims")]
    header_bytes: u64,
    /// Distance of neighbouring voxels along x, y and z, for any volume: in place of that of its file, for example
    /// 0.2x0.2x0.6um. Units are cm, mm, um, nm and angstrom. Default of raw voxels: 1x1x1.
    #[arg(long, help_heading = SEVERAL, value_name = "SXxSYxSZ[UNIT]", value_parser = lengths)]
    spacing: Option<Lengths>,
}

/// Lengths along x, y and z with an optional unit.
type Lengths = ([f64; 3], Option<Unit>);

impl RawArgs {
    /// The layout, if flags give one.
    pub(crate) fn layout(&self) -> Option<RawLayout> {
        let plain = RawLayout::new(self.dims?, self.voxel_type?);
        Some(RawLayout {
            byte_order: if self.big_endian { ByteOrder::Big } else { ByteOrder::Little },
            header_bytes: self.header_bytes,
            spacing: self.spacing.map_or(plain.spacing, |(lengths, _)| lengths),
            ..plain
        })
    }

    /// The spacing and its unit, if the flag gives them.
    pub(crate) fn spacing(&self) -> Option<Lengths> {
        self.spacing
    }

    /// `volume` with the spacing that the flag gives.
    pub(crate) fn spaced(&self, volume: Volume) -> Result<Volume, CliError> {
        let Some((lengths, unit)) = self.spacing else { return Ok(volume) };
        let mut volume = volume.with_spacing(lengths.into())?;
        volume.unit = unit.or(volume.unit);
        Ok(volume)
    }
}

/// Heading in `--help`.
const LOOK: &str = "Look of a volume without a scene";

/// The picture of a volume without a scene.
#[derive(Debug, Args)]
pub(crate) struct LookArgs {
    /// Kind of picture: tissue (glassy layers around the densest, solid one), bone, vessel, grey, fluorescence, maximum (of each ray), or a
    /// transfer preset of the window: soft-tissue, skin, lung, ct-bone, ct-vessels (CT), mr, mr-t1, mr-t2, micro-ct, haze,
    /// densest or layers. Or a file: a preset of 3D Slicer (.vp, .vp.json) or ParaView (.json), or rendering settings of OMERO
    /// (.json).
    #[arg(long, help_heading = LOOK, value_name = "NAME|FILE", value_parser = look)]
    look: Option<NameOrFile>,
    /// Show a range of values of this width around --level in grey, from transparent to most opaque.
    #[arg(long, help_heading = LOOK, value_name = "WIDTH", value_parser = width, allow_negative_numbers = true, requires = "level", conflicts_with = "look")]
    window: Option<f64>,
    /// Centre of the range of --window.
    #[arg(long, help_heading = LOOK, value_name = "CENTRE", allow_negative_numbers = true, requires = "window")]
    level: Option<f64>,
}

/// A look, or the file of a preset.
#[derive(Clone, Debug, PartialEq)]
enum NameOrFile {
    Name(Look),
    File(PathBuf),
}

/// Parses the name of a look. Other words are the file of a preset if there is one, or if they end as one does.
fn look(text: &str) -> Result<NameOrFile, String> {
    const ENDINGS: [&str; 4] = [".vp", ".json", ".yml", ".yaml"];
    let is_file = || {
        let lower = text.to_lowercase();
        Path::new(text).is_file() || ENDINGS.iter().any(|ending| lower.ends_with(ending))
    };
    match Look::named(text) {
        Ok(look) => Ok(NameOrFile::Name(look)),
        Err(_) if is_file() => Ok(NameOrFile::File(PathBuf::from(text))),
        Err(names) => Err(names),
    }
}

/// The picture that flags ask for.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Wanted {
    wish: Wish,
    /// File of a preset.
    preset: Option<PathBuf>,
}

impl Wanted {
    /// Whether nothing is asked for.
    pub(crate) fn is_none(&self) -> bool {
        *self == Self::default()
    }
}

impl LookArgs {
    pub(crate) fn wanted(&self) -> Wanted {
        let look = match self.look {
            Some(NameOrFile::Name(look)) => Some(look),
            _ => None,
        };
        let window = self.window.zip(self.level).map(|(window, level)| [window, level]);
        Wanted { wish: Wish { look, window, ..Wish::default() }, preset: self.preset().cloned() }
    }

    /// File of a preset.
    pub(crate) fn preset(&self) -> Option<&PathBuf> {
        match &self.look {
            Some(NameOrFile::File(path)) => Some(path),
            _ => None,
        }
    }
}

/// Parses the number of a component.
fn component_number(text: &str) -> Result<usize, String> {
    text.parse().map_err(|_| "write the number of a component, from 0 on; relume info FILE lists them".to_owned())
}

/// Parses the width of a window of values.
pub(crate) fn width(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|&number: &f64| number > 0.0 && number.is_finite());
    number.ok_or_else(|| "write a width above 0, such as 400".to_owned())
}

/// The flag `--light`.
#[derive(Debug, Args)]
pub(crate) struct LightArgs {
    /// Light the scene with NAME in place of its own lights (repeatable: lights add up).
    ///
    /// NAME is a light of the scene, else a standard (D65, …), else a file with two columns, nm and power. A light of the
    /// scene shines from its own position. Any other light takes the place of the lights of the picture: it shines from
    /// their positions, with their weights, so that brightness and shadows stay, or only from POSITION; `relume info`
    /// lists the positions. WEIGHT is a factor. NAME:#RRGGBB is a light of the scene in bands of its own, such as that of a
    /// channel, under which what it shows has this colour. A name may contain @ and =: if the whole text is the name of
    /// a light or a file, Relume does not split it.
    #[arg(long = "light", value_name = "NAME[@POSITION][=WEIGHT]")]
    pub(crate) lights: Vec<LightRequest>,
}

/// Keys of a scene that a volume of the command line takes the place of.
const OF_SCENES_VOLUME: [&str; 16] = [
    "volume.file",
    "volume.phantom",
    "volume.phantom_labels",
    "volume.labels",
    "volume.type",
    "volume.dims",
    "volume.slices",
    "volume.byte_order",
    "volume.header_bytes",
    "volume.component",
    "volume.time",
    "volume.array",
    "volume.series",
    "volume.level",
    "volume.axes",
    "volume.resample",
];

/// Keys of a scene that a flag overrides.
const OVERRIDDEN: [(&str, &[&str]); 18] = [
    ("--clip", &["clip.planes"]),
    ("--hide", &["hidden"]),
    ("--crop", &["crop"]),
    ("--labels", &["volume.labels", "volume.phantom_labels"]),
    ("--downsample", &["volume.downsample"]),
    ("--spacing", &["volume.spacing"]),
    ("--component", &["volume.component"]),
    ("--time", &["volume.time"]),
    ("--array", &["volume.array"]),
    ("--series", &["volume.series"]),
    ("--pyramid-level", &["volume.level"]),
    ("--axes", &["volume.axes"]),
    ("--resample", &["volume.resample"]),
    ("--dims", &["volume.type", "volume.dims", "volume.byte_order", "volume.header_bytes"]),
    ("--tolerance", &["accuracy.tolerance", "accuracy.k"]),
    ("--k", &["accuracy.k"]),
    ("--model", &["accuracy.model"]),
    ("--accumulate", &["accuracy.accumulate"]),
];

/// The definition of `[NAME=]LOW:HIGH`.
fn range(text: &str) -> Result<Definition, String> {
    let (field, ends) = text.rsplit_once('=').map_or((None, text), |(name, ends)| (Some(name), ends));
    let number = |end: &str| end.trim().parse::<f64>().ok().filter(|number| number.is_finite());
    let ends = ends.split_once(':').and_then(|(low, high)| Some((number(low)?, number(high)?)));
    let (low, high) = ends
        .filter(|(low, high)| low < high)
        .ok_or("write LOW:HIGH, two numbers, the lower one first, such as 100:4000 or GFP=100:4000")?;
    let key = field.map_or_else(|| "transfer".to_owned(), |name| format!("volumes.{}.transfer", name.trim()));
    Ok(Definition { given: format!("--range {text}"), text: format!("{key}.range=[{low:?}, {high:?}]") })
}

/// Flags of what a scene shows: those that a picture has, but no volume.
pub(crate) const OF_PICTURE: [&str; 6] = ["--quality", "--clip", "--range", "--hide", "--mask", "--crop"];

/// Definitions of the factor by a mask.
#[derive(Clone, Debug)]
struct Mask(Vec<Definition>);

/// The definitions of `NAME=[!]WHAT:NUMBERS`.
fn mask(text: &str) -> Result<Mask, String> {
    let parts = text.split_once('=').and_then(|(field, rest)| Some((field.trim(), rest.rsplit_once(':')?)));
    let (field, (what, numbers)) = parts
        .ok_or("write NAME=FILE:LABELS, such as pet=organs.nrrd:1, or NAME=OTHER:VALUE, such as spots=nuclei:300")?;
    let (what, is_outside) = what.trim().strip_prefix('!').map_or((what.trim(), false), |what| (what, true));
    let parsed: Option<Vec<f64>> =
        numbers.split(',').map(|number| number.trim().parse().ok().filter(|number: &f64| number.is_finite())).collect();
    let numbers = parsed.ok_or_else(|| format!("{numbers:?} is no number, nor numbers separated by commas"))?;
    let [outside, inside] = if is_outside { [1, 0] } else { [0, 1] };
    let define = |text: String| Definition { given: format!("--mask {}", field.to_owned() + "=" + what), text };
    let by = |name: &str, from: f64, to: f64| {
        define(format!("volumes.{field}.transfer.by={{ {name:?} = [[{from:?}, {outside}], [{to:?}, {inside}]] }}"))
    };
    let path = Path::new(what);
    if path.is_file() {
        let path = std::path::absolute(path).map_err(|error| error.to_string())?;
        // Of labels that are 1 inside, half-way.
        let file = define(format!("volumes.mask={{ file = {:?}, only = {numbers:?} }}", path.display().to_string()));
        return Ok(Mask(vec![file, by("mask", 0.4, 0.6)]));
    }
    match (numbers.as_slice(), path.extension()) {
        // Values of a factor ascend: it rises just below.
        ([value], None) => Ok(Mask(vec![by(what, value - (value.abs() * 1e-4).max(1e-9), *value)])),
        (_, Some(_)) => Err(format!("there is no file {what}")),
        _ => Err(format!("{what} is no file, and of another field one value is compared: NAME=OTHER:VALUE")),
    }
}

/// The definition of a crop box.
fn crop(text: &str) -> Result<Definition, String> {
    let place = |place: &str| {
        let place = place.trim();
        let number = place.strip_suffix('%').unwrap_or(place).parse::<f64>().ok()?;
        number.is_finite().then(|| if place.ends_with('%') { format!("{place:?}") } else { format!("{number:?}") })
    };
    let axis = |axis: &str| {
        let (low, high) = axis.split_once(':')?;
        Some([place(low)?, place(high)?])
    };
    let axes: Option<Vec<[String; 2]>> = text.split(',').map(axis).collect();
    let axes: Option<[[String; 2]; 3]> = axes.and_then(|axes| axes.try_into().ok());
    let [x, y, z] = axes.ok_or("write LOW:HIGH along x, y and z, such as 25%:75%,0:100,50%:100%")?;
    let end = |end: usize| format!("[{}, {}, {}]", x[end], y[end], z[end]);
    let text_of_box = format!("crop={{ min = {}, max = {} }}", end(0), end(1));
    Ok(Definition { given: format!("--crop {text}"), text: text_of_box })
}

impl SceneArgs {
    /// Changes of the scene.
    pub(crate) fn options(&self) -> SceneOptions {
        SceneOptions {
            volume: self.volume.clone(),
            raw: self.raw.layout(),
            selection: self.selection.selection(),
            labels: self.labels.clone(),
            label_names: self.label_names.clone(),
            spacing: self.raw.spacing(),
            downsample: self.downsample,
            definitions: self
                .define
                .definitions()
                .chain(self.accuracy.definitions())
                .chain(self.clip_planes())
                .chain(self.range.iter().cloned())
                .chain(self.hidden())
                .chain(self.mask.iter().flat_map(|mask| mask.0.iter().cloned()))
                .chain(self.crop.clone())
                .collect(),
            quality: self.quality,
            wish: Wish::default(),
            preset: None,
            beside: self.beside.clone(),
            channels: self.channels.as_ref().map(|names| names.split(',').map(|name| name.trim().to_owned()).collect()),
        }
    }

    /// The definition of the clip planes, if flags give any.
    fn clip_planes(&self) -> Option<Definition> {
        let given = self.clip.iter().map(|plane| format!("--clip {plane}")).collect::<Vec<_>>().join(" ");
        (!self.clip.is_empty()).then(|| Definition { given, text: format!("clip.planes={:?}", self.clip) })
    }

    /// The definition of the hidden fields, if a flag names any.
    fn hidden(&self) -> Option<Definition> {
        let names = self.hide.as_ref()?;
        let listed: Vec<&str> = names.split(',').map(str::trim).collect();
        Some(Definition { given: format!("--hide {names}"), text: format!("hidden={listed:?}") })
    }

    /// Flags that change the scene or its volume, and whether each is given.
    fn flags(&self) -> Vec<(&'static str, bool)> {
        let others = [
            ("--volume", self.volume.is_some()),
            ("--channels", self.channels.is_some()),
            ("a further VOLUME", !self.beside.is_empty()),
            ("--labels", self.labels.is_some()),
            ("--label-names", self.label_names.is_some()),
            ("--downsample", self.downsample.is_some()),
            ("--define", !self.define.is_empty()),
            ("--dims", self.raw.dims.is_some()),
            ("--spacing", self.raw.spacing.is_some()),
        ];
        others.into_iter().chain(self.of_picture()).chain(self.selection.choices()).collect()
    }

    /// A flag that changes the scene or its volume, if one is given; `--tolerance` is not counted.
    pub(crate) fn given(&self) -> Option<&'static str> {
        let given = self.flags().into_iter().filter(|(_, given)| *given).map(|(flag, _)| flag);
        let of_colour = self.accuracy.given().into_iter().filter(|flag| *flag != "--tolerance");
        given.chain(of_colour).next()
    }

    pub(crate) fn load(&self, progress: &dyn Progress) -> Result<SceneFile, CliError> {
        self.load_as(&Wanted::default(), HostMemory::Whole, progress).map(|(file, _)| file)
    }

    /// The scene file or volume that the arguments name. A volume without a scene file is opened as a volume without a
    /// scene.
    ///
    /// # Errors
    ///
    /// [`CliError::Usage`] for a second volume, and for definitions that a flag or the volume overrides; those of a preset.
    pub(crate) fn source(&self, wanted: &Wanted) -> Result<Source, CliError> {
        let Wanted { wish, preset } = wanted.clone();
        let source = Source { path: self.scene.clone(), options: SceneOptions { wish, preset, ..self.options() } };
        if let (Some(one), Some(other)) = (source.bare_volume(), &self.volume) {
            return Err(CliError::Usage(format!(
                "{} is a volume, and --volume {} is in its place: name one of the two, or both without --volume, to show them \
                 together",
                one.display(),
                other.display()
            )));
        }
        let source = source.or_its_volume();
        let is_bare = source.bare_volume().is_some() || source.path.is_none() && source.options.volume.is_some();
        if let (Some(further), false) = (self.beside.first(), is_bare) {
            let message = format!(
                "{} is beside no volume: a scene states its volumes itself, in [volumes]; name the volume alone",
                further.display()
            );
            return Err(CliError::Usage(message));
        }
        if self.beside.len() >= FIELDS {
            let message = format!("{} volumes are named; a picture shows up to {FIELDS}", self.beside.len() + 1);
            return Err(CliError::Usage(message));
        }
        if self.channels.is_some() && !is_bare {
            let message =
                "--channels has no effect on a scene, which states its channels in [volumes]; name the volume alone";
            return Err(CliError::Usage(message.to_owned()));
        }
        if let Some(path) = &wanted.preset {
            // A volume takes longer to read than a mistake.
            import::read(path)?;
        }
        self.check_definitions(&source)?;
        Ok(source)
    }

    /// Refuses definitions of keys that a flag or the volume of `source` overrides.
    fn check_definitions(&self, source: &Source) -> Result<(), CliError> {
        let keys: Vec<&str> = self.define.define.iter().map(|text| text.split('=').next().unwrap_or(text)).collect();
        for (at, key) in keys.iter().enumerate() {
            if let Some(later) = keys[at + 1..].iter().rposition(|other| other.trim() == key.trim()) {
                let all = &self.define.define;
                tracing::warn!("-D {} has no effect: -D {} follows", all[at], all[at + 1 + later]);
            }
        }
        let by_volume = self.volume.is_some() || source.bare_volume().is_some();
        let whose = "the volume in place of that of the scene";
        let by_flags = OVERRIDDEN.iter().filter(|(flag, _)| self.is_given(flag));
        let by_flags = by_flags.flat_map(|(flag, keys)| keys.iter().map(move |key| (*flag, *key)));
        let overriding = OF_SCENES_VOLUME.iter().filter(|_| by_volume).map(|key| (whose, *key)).chain(by_flags);
        for (by, key) in overriding {
            let is_within =
                |given: &str| given == key || given.strip_prefix(key).is_some_and(|rest| rest.starts_with('.'));
            if let Some(at) = keys.iter().position(|given| is_within(given.trim())) {
                return Err(CliError::Usage(format!(
                    "-D {} has no effect beside {by}; {}",
                    self.define.define[at],
                    if by == whose { "use the flag for it, such as --component" } else { "omit one of the two" }
                )));
            }
        }
        Ok(())
    }

    /// Whether a flag of the volume or of the colour accuracy is given.
    fn is_given(&self, flag: &str) -> bool {
        let of_accuracy = self.accuracy.given().into_iter().map(|flag| (flag, true));
        self.flags().into_iter().chain(of_accuracy).any(|(name, given)| given && name == flag)
    }

    /// [`OF_PICTURE`], and whether each is given.
    pub(crate) fn of_picture(&self) -> impl Iterator<Item = (&'static str, bool)> {
        let given = [
            self.quality.is_some(),
            !self.clip.is_empty(),
            !self.range.is_empty(),
            self.hide.is_some(),
            self.mask.is_some(),
            self.crop.is_some(),
        ];
        OF_PICTURE.into_iter().zip(given)
    }

    /// Refuses volumes beside the first for a `command` that reads one.
    pub(crate) fn require_one(&self, command: &str) -> Result<(), CliError> {
        let Some(further) = self.beside.first() else { return Ok(()) };
        let message =
            format!("relume {command} takes one volume, and {} is another; name one of them", further.display());
        Err(CliError::Usage(message))
    }

    /// Whether `--time all` asks for all time steps.
    pub(crate) fn is_of_all_times(&self) -> bool {
        self.selection.time == Some(ALL_TIMES)
    }

    /// [`Self::source`] for all time steps; refuses a look of a scene, which has its own.
    pub(crate) fn source_of_look(&self, wanted: &Wanted) -> Result<Source, CliError> {
        let mut source = self.source(wanted)?;
        source.options.selection.time = source.options.selection.time.filter(|_| !self.is_of_all_times());
        if !wanted.is_none() && source.bare_volume().is_none() {
            let message = "--look, --window and --level are for a volume without a scene; a scene states its own look";
            return Err(CliError::Usage(message.to_owned()));
        }
        Ok(source)
    }

    /// Reads the scene, or makes one for a volume, whose voxels are kept in `memory`, and says how it was made; also returns the
    /// statistics of the volume.
    pub(crate) fn load_as(
        &self,
        wanted: &Wanted,
        memory: HostMemory,
        progress: &dyn Progress,
    ) -> Result<(SceneFile, Statistics), CliError> {
        let (file, statistics) = self.read(wanted, memory, progress)?;
        if let Some(guess) = &file.guess {
            let time = file.scene.volume().selection.time;
            tracing::info!("{guess}{}", time.map_or_else(String::new, of_time));
            if !self.range.is_empty() {
                let ranges: Vec<&str> = self.range.iter().map(|range| range.given.as_str()).collect();
                tracing::info!("These are the values before {}.", ranges.join(" "));
            }
            let are_channels = self.channels.is_some() || !file.scene.fields.sharing().is_empty();
            tracing::info!("{}", if are_channels { OF_CHANNELS } else { OF_LOOK });
        }
        Ok((file, statistics))
    }

    /// [`Self::load_as`] without a word about a scene that is made for a volume.
    pub(crate) fn read(
        &self,
        wanted: &Wanted,
        memory: HostMemory,
        progress: &dyn Progress,
    ) -> Result<(SceneFile, Statistics), CliError> {
        let mut source = self.source_of_look(wanted)?;
        source.options.selection.memory = memory;
        let (file, statistics) = source.read(progress)?;
        let scene = &file.scene;
        let labels = scene.labels.iter().flat_map(|labels| &labels.volume.notes);
        let further = scene.fields.further().iter().flat_map(|field| &field.volume.notes);
        for note in scene.volume().notes.iter().chain(further).chain(labels) {
            tracing::warn!("{note}");
        }
        if let Some(unlike) = design::unlike(&file) {
            tracing::warn!("{unlike}; `relume design SCENE --save-scene NEW` solves it again");
        }
        if let (Some(path), Some([])) = (&self.labels, scene.labels.as_ref().map(|labels| &labels.declared[..])) {
            tracing::warn!(
                "--labels {}: the scene declares no labels ([labels.N]), so the file is not used",
                path.display()
            );
        }
        Ok((file, statistics))
    }
}

/// Tells that a first look is that of one time step.
fn of_time(time: usize) -> String {
    format!(
        " The look is that of time step {time} alone, so others differ in range and camera; `relume render --time all` gives \
         all the same."
    )
}

impl LightArgs {
    /// Files that are read unless a light of the scene has their name.
    pub(crate) fn files(&self) -> Vec<PathBuf> {
        self.lights.iter().flat_map(|light| light.files(Path::new(""))).collect()
    }

    /// The requested mix, or `shown`, the mix of the picture so far, without a request; `stated` is the mix of the scene.
    /// Colours of lights are those of these `surfaces` under them.
    pub(crate) fn mix(
        &self,
        stated: &Mix,
        shown: &Mix,
        positions: &[String],
        surfaces: &[Spectrum],
    ) -> Result<Requested, CliError> {
        if self.lights.is_empty() {
            return Ok(Requested { mix: shown.clone(), placed: Vec::new() });
        }
        let requests: Vec<String> = self.lights.iter().map(|request| request.0.clone()).collect();
        let (stated, plain) = document::recoloured(stated, &requests, surfaces)
            .map_err(|message| CliError::Failed(format!("--light {message}")))?;
        let plain: Vec<LightRequest> = plain.into_iter().map(LightRequest).collect();
        Ok(document::requested(&stated, shown, positions, &plain, Path::new(""))?)
    }
}

/// Tells from where lights shine that took the place of a mix, a line each.
pub(crate) fn told_of_placed(placed: &[Placed]) -> String {
    let of_light = |Placed { name, shares, weights }: &Placed| {
        let instead = match shares {
            Shares::Shown => "in place of the lights of the picture",
            Shares::Stated => "in place of the lights of the scene, since no light is on in the picture",
            Shares::Everywhere => "from every position, since no light of the scene has an intensity",
        };
        let at = |(position, weight): &(String, f64)| format!("{name}@{position}={}", brief(*weight));
        let listed: Vec<String> = weights.iter().map(at).collect();
        format!("--light {name} shines {instead}: {}\n", listed.join(", "))
    };
    placed.iter().map(of_light).collect()
}

/// Adds the lights that took the place of a mix to the JSON of a command, if there are any.
pub(crate) fn add_placed(json: &mut serde_json::Value, placed: &[Placed]) {
    if placed.is_empty() {
        return;
    }
    let of_light = |Placed { name, shares, weights }: &Placed| {
        let instead = match shares {
            Shares::Shown => "picture",
            Shares::Stated => "scene",
            Shares::Everywhere => "every position",
        };
        let at = |(position, weight): &(String, f64)| serde_json::json!({"position": position, "weight": weight});
        serde_json::json!({"name": name, "in_place_of": instead, "at": weights.iter().map(at).collect::<Vec<_>>()})
    };
    json["placed"] = placed.iter().map(of_light).collect();
}

/// Parses `AxBxC`, whole numbers from 1.
pub(crate) fn three(text: &str) -> Result<[usize; 3], String> {
    let numbers = split(text, |part| part.parse().ok().filter(|&n: &usize| n > 0));
    numbers.ok_or_else(|| "write three whole numbers of at least 1, such as 2x2x1".to_owned())
}

/// Parses `AxBxC`, positive numbers, and a unit.
fn lengths(text: &str) -> Result<Lengths, String> {
    let (numbers, name) =
        text.split_at(text.rfind(|letter: char| letter.is_ascii_digit() || letter == '.').map_or(0, |at| at + 1));
    let unit = match name.trim() {
        "" => None,
        name => Some(Unit::named(name).ok_or_else(|| format!("{name} is no unit; write cm, mm, um, nm or angstrom"))?),
    };
    let numbers = split(numbers, |part| part.parse().ok().filter(|&n: &f64| n > 0.0 && n.is_finite()));
    let numbers = numbers.ok_or_else(|| "write three positive numbers, such as 1x1x1.5 or 0.2x0.2x0.6um".to_owned())?;
    Ok((numbers, unit))
}

/// Parses `x,y,z`.
pub(crate) fn voxel(text: &str) -> Result<[usize; 3], String> {
    let parts: Option<Vec<usize>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    parts.and_then(|parts| parts.try_into().ok()).ok_or_else(|| "write x,y,z, such as 10,20,30".to_owned())
}

fn split<T>(text: &str, number: impl Fn(&str) -> Option<T>) -> Option<[T; 3]> {
    let parts: Option<Vec<T>> = text.split(['x', '×', ',']).map(|part| number(part.trim())).collect();
    parts?.try_into().ok()
}

/// Parses `WxH`.
pub(crate) fn size(text: &str) -> Result<[usize; 2], String> {
    const LARGEST: usize = crate::output::Picture::LARGEST_SIDE;
    const MOST_PIXELS: usize = 1 << 31;
    let parts: Option<Vec<usize>> = text.split(['x', '×']).map(|part| part.trim().parse().ok()).collect();
    let size: Option<[usize; 2]> = parts.and_then(|parts| parts.try_into().ok());
    match size {
        Some([width, height]) if width.max(height) <= LARGEST && width.saturating_mul(height) > MOST_PIXELS => Err(
            format!("{width}×{height} is {} pixels; a picture has at most {MOST_PIXELS}", width.saturating_mul(height)),
        ),
        Some(size) if size.iter().all(|side| (1..=LARGEST).contains(side)) => Ok(size),
        Some(_) => Err(format!("each side of a picture has 1 to {LARGEST} pixels")),
        None => Err("write WIDTHxHEIGHT, such as 800x600".to_owned()),
    }
}

/// Reflectances of the materials of a scene.
pub(crate) fn surfaces_of(scene: &Scene) -> Vec<Spectrum> {
    scene.materials.iter().map(|material| material.reflectance.spectrum().clone()).collect()
}

/// Ways to change a first look.
const OF_LOOK: &str = "To change it, use --look (tissue, bone, vessel, grey, fluorescence, maximum, a transfer preset or a file: see --help), use \
                       --window and --level, or edit the scene that --save-scene FILE writes.";

/// Ways to change a first look at channels.
const OF_CHANNELS: &str = "To change it, name some of them with --channels, show one with --component N, also with --look or --window and --level, \
                           show the largest values with --look maximum, or edit the scene that --save-scene FILE writes.";
