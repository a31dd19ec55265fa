//! TIFF, `BigTIFF`, OME-TIFF and the stacks of `ImageJ`: `.tif`, `.tiff`, `.btf`.
//!
//! Tags and codes follow TIFF 6.0 (Adobe, 1992), its technical notes, and the `BigTIFF` proposal.

mod directory;
mod imagej;
mod ome;
mod page;
mod stated;
mod strips;

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};

use crate::data;
use crate::several::{Series, Several};
use crate::stream::count;
use crate::{Geometry, Part, Selection, Volume, VolumeError};
pub(crate) use directory::recognises;
use directory::{Tiff, tag};
use ome::Ome;
use page::{Chunks, Compression, Reading};
pub(crate) use page::{Page, Picture, Sample};
use relume_base::progress::{Progress, Quiet};
use stated::Stated;
pub(crate) use strips::{Stack, unpack_bits};

/// The page of the file `path`, which is file `file` of a folder of slices.
pub(crate) fn slice(path: &Path, file: usize) -> Result<Page, VolumeError> {
    let contents = Contents::read(path, file, &Quiet)?;
    let [page] = &contents.pages[..] else {
        let problem =
            format!("a slice of a folder has one page, but the file has {}; open the file by itself", contents.all);
        return Err(VolumeError::Field { path: path.to_owned(), place: "header".to_owned(), problem });
    };
    Ok(page.clone())
}

/// Whether the first bytes of a file identify the description of planes in other files.
pub(crate) fn recognises_companion(beginning: &[u8]) -> bool {
    ome::recognises(beginning)
}

/// Longest companion file.
const LONGEST_COMPANION: u64 = 256 << 20;

/// The files of the folder `files`, if they are planes that OME-XML describes together: the file with the description, first,
/// and all other TIFF files. A description is in a companion file, or that of the first TIFF file by name.
pub(crate) fn described_together(files: &[PathBuf]) -> Vec<PathBuf> {
    let name = |path: &PathBuf| path.file_name().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    let is_tiff =
        |path: &&PathBuf| [".tif", ".tiff", ".btf", ".tf2", ".tf8"].iter().any(|end| name(path).ends_with(end));
    let companions: Vec<&PathBuf> = files.iter().filter(|path| name(path).ends_with(".companion.ome")).collect();
    let names_others = |path: &&PathBuf| {
        let contents = Contents::first(path).ok();
        contents.is_some_and(|text| match ome::metadata_file(&text) {
            Some(other) => data::existing(path, &other).is_some(),
            None => Ome::read(&text).is_ok_and(|ome| ome.names_files()),
        })
    };
    let main = match companions[..] {
        [companion] => Some(companion),
        [] => files.iter().find(is_tiff).filter(names_others),
        // Each describes a volume.
        _ => None,
    };
    let Some(main) = main else { return Vec::new() };
    std::iter::once(main).chain(files.iter().filter(|path| *path != main && is_tiff(path))).cloned().collect()
}

/// The file with the description of the planes of the file `path`, and its contents: `path` itself, or the file that its
/// description names.
fn with_description(path: &Path, progress: &dyn Progress) -> Result<(PathBuf, Contents), VolumeError> {
    let contents = Contents::read(path, 0, progress)?;
    let other = match &contents.description {
        Description::Ome(text) => ome::metadata_file(text),
        _ => None,
    };
    let Some(name) = other else { return Ok((path.to_owned(), contents)) };
    let main = data::beside(path, &name)?;
    if !main.is_file() {
        let name = super::lengths::printable(&name);
        let problem =
            format!("the description of the planes is in the file {name:?}, which is missing; put it beside this one");
        return Err(VolumeError::Field { path: path.to_owned(), place: "page 1, OME-XML".to_owned(), problem });
    }
    let contents = Contents::read(&main, 0, progress)?;
    Ok((main, contents))
}

/// Reads a TIFF file, or the planes that a companion file describes.
pub(crate) fn read(path: &Path, selection: &Selection, progress: &dyn Progress) -> Result<Volume, VolumeError> {
    let source_name = path.display().to_string();
    selection.no_array(&source_name)?;
    let (main, contents) = with_description(path, progress)?;
    let path = main.as_path();
    let mut files = Files { main: path, paths: vec![path.to_owned()], opened: HashMap::new(), progress };
    let (mut stated, picture, mut chosen) = match &contents.description {
        Description::Ome(text) => files.ome(&contents, text, selection)?,
        Description::ImageJ { description, own } => {
            selection.no_series(&source_name)?;
            let (images, stated) = imagej::read(description, contents.pages.len(), contents.resolution, own);
            in_order(path, contents.imagej_pages(path, images)?, stated, selection)?
        }
        Description::None => {
            selection.no_series(&source_name)?;
            let sizes = [contents.pages.len(), 1, 1];
            in_order(path, contents.pages.clone(), Stated { sizes, ..Stated::default() }, selection)?
        }
    };
    let fine = picture;
    let picture = chosen.take_level(&source_name, &files.paths, &fine, selection)?;
    let steps = [[fine.width, picture.width], [fine.height, picture.height]];
    let steps = steps.map(|[fine, coarse]| relume_base::number::count(fine) / relume_base::number::count(coarse));
    let origin = [0, 1].map(|axis| {
        let length = stated.spacing[axis].unwrap_or(1.0);
        if picture != fine {
            stated.spacing[axis] = Some(length * steps[axis]);
        }
        // A coarse voxel lies at the centre of the fine ones.
        length * (steps[axis] - 1.0) / 2.0
    });
    volume(&source_name, files.paths, stated, (&picture, origin), chosen, progress)
}

/// The pages that were chosen, in order of z.
struct Chosen {
    pages: Vec<Page>,
    /// Index of the first of them along z.
    first: usize,
    /// The slices of which they are a part.
    part: Option<Part>,
    /// Level of resolution, if there are several.
    level: Option<usize>,
    sample: usize,
    component: usize,
    /// Components that can be chosen.
    components: usize,
}

impl Chosen {
    /// The `pages` that `selection` chose of a volume of `depth` slices.
    fn new(
        pages: Vec<Page>,
        (selection, depth): (&Selection, usize),
        [sample, component, components]: [usize; 3],
    ) -> Self {
        let (first, part) = (selection.slices(depth).start, selection.part(depth, 1));
        Self { pages, first, part, level: None, sample, component, components }
    }

    /// Replaces the pages, which are like `fine`, by those of the chosen level of resolution, and returns what these are
    /// like. The levels of a page are its directories of smaller pages of the same type.
    fn take_level(
        &mut self,
        source_name: &str,
        paths: &[PathBuf],
        fine: &Picture,
        selection: &Selection,
    ) -> Result<Picture, VolumeError> {
        let depth = self.pages.len();
        let mut tiff = Tiff::open(&paths[self.pages[0].file])?;
        let coarser = levels(&mut tiff, &self.pages[0], fine)?;
        let pictures: Vec<Picture> = std::iter::once(*fine).chain(coarser.iter().map(|page| *page.picture())).collect();
        let dims: Vec<[usize; 3]> = pictures.iter().map(|picture| [picture.width, picture.height, depth]).collect();
        let level = selection.level(source_name, &dims)?;
        self.level = (dims.len() > 1).then_some(level);
        if level == 0 {
            return Ok(*fine);
        }
        let mut file = self.pages[0].file;
        for page in &mut self.pages {
            if page.file != file {
                file = page.file;
                tiff = Tiff::open(&paths[file])?;
            }
            let mut own = levels(&mut tiff, page, fine)?;
            if own.get(level - 1).is_none_or(|coarse| !coarse.picture().is_like(&pictures[level])) {
                let place = format!("page {}", page.number);
                let problem = format!("it has no level of {}", pictures[level]);
                return Err(VolumeError::Field { path: paths[file].clone(), place, problem });
            }
            *page = own.swap_remove(level - 1);
        }
        Ok(pictures[level])
    }
}

/// Coarser levels of `page`, which is like `fine`, in the order of the file.
fn levels(tiff: &mut Tiff, page: &Page, fine: &Picture) -> Result<Vec<Page>, VolumeError> {
    /// More levels are a mistake.
    const MOST: u64 = 64;
    let Some(offsets) = page.levels else { return Ok(Vec::new()) };
    let mut levels: Vec<Page> = Vec::new();
    for index in 0..offsets.count.min(MOST) {
        let place = format!("page {}, SubIFDs", page.number);
        let Some(offset) = tiff.whole(offsets, index, &place)? else { continue };
        let directory = tiff.directory(offset, page.number)?;
        // Other directories than levels may lack what a page needs.
        let coarse = Reading { tiff, directory: &directory }.page(page.file, levels.last());
        levels.extend(coarse.ok().filter(|coarse| {
            let Picture { width, height, samples, sample, .. } = *coarse.picture();
            let is_smaller = width <= fine.width && height <= fine.height;
            is_smaller
                && [width, height] != [fine.width, fine.height]
                && (samples, sample) == (fine.samples, fine.sample)
        }));
    }
    Ok(levels)
}

/// The volume of the chosen pages, which are like `picture`, with voxel (0, 0, 0) at `left`, `top`.
fn volume(
    source_name: &str,
    paths: Vec<PathBuf>,
    mut stated: Stated,
    (picture, [left, top]): (&Picture, [f64; 2]),
    chosen: Chosen,
    progress: &dyn Progress,
) -> Result<Volume, VolumeError> {
    let dims = [picture.width, picture.height, chosen.pages.len()];
    let spacing = DVec3::from_array(stated.spacing.map(|length| length.unwrap_or(1.0)));
    let geometry = Geometry::new(
        source_name,
        dims,
        spacing,
        DVec3::new(left, top, relume_base::number::count(chosen.first) * spacing.z),
        DMat3::IDENTITY,
    )?;
    let stack = Stack { paths, pages: chosen.pages, sample: chosen.sample };
    let voxels = stack.read(progress)?;
    let mut volume = Volume::new(source_name, voxels, geometry)?;
    volume.unit = stated.unit;
    volume.components = chosen.components;
    volume.part = chosen.part;
    volume.selection.level = chosen.level;
    volume.has_labels = picture.sample == Sample::Bits(1);
    if let Some([slope, intercept]) = stated.scale {
        (volume.slope, volume.intercept) = (slope, intercept);
    }
    let window = stated.windows.get(chosen.component).or(stated.windows.last());
    volume.presets.windows.extend(window.cloned().flatten());
    if let Some(Some(colour)) = stated.colours.get(chosen.component) {
        volume.presets.take_colour(colour);
    }
    if has_names(&stated, picture, chosen.components) {
        volume.component_names = stated.names;
    }
    volume.metadata = stated.metadata;
    let depth = chosen.part.map_or(dims[2], |part| part.depth);
    let unknown: Vec<&str> = (0..3)
        .filter(|&axis| [dims[0], dims[1], depth][axis] > 1 && stated.spacing[axis].is_none())
        .map(|axis| ["x", "y", "z"][axis])
        .collect();
    let assumed = if stated.spacing == [None; 3] {
        Some("the file states no spacing; Relume uses 1 1 1".to_owned())
    } else {
        let along = (!unknown.is_empty()).then(|| unknown.join(" and "));
        along.map(|along| format!("the file states no spacing along {along}; Relume uses 1"))
    };
    stated.notes.extend(assumed.clone());
    if picture.photometric == 3 {
        stated.notes.push("the voxels are indices into a colour map, which is not applied".to_owned());
    }
    volume.notes = stated.notes.into_iter().map(|note| format!("{source_name}: {note}")).collect();
    volume.assumed_spacing = assumed.map(|note| format!("{source_name}: {note}"));
    let mut used: Vec<bool> = vec![false; stack.paths.len()];
    stack.pages.iter().for_each(|page| used[page.file] = true);
    // The file that was asked for has the description.
    used[0] = true;
    let paths = stack.paths.into_iter().zip(used);
    volume.files = paths.filter_map(|(path, is_used)| is_used.then_some(path)).collect();
    Ok(volume)
}

/// Chooses among pages in the order channel, z, time.
fn in_order(
    path: &Path,
    pages: Vec<Page>,
    stated: Stated,
    selection: &Selection,
) -> Result<(Stated, Picture, Chosen), VolumeError> {
    let source_name = path.display().to_string();
    let [depth, channels, _] = stated.sizes;
    let picture = alike(&[path.to_owned()], &pages)?;
    let (component, components) = component(&source_name, &stated, &picture, channels, selection)?;
    let time = selection.time(&source_name, stated.sizes[2])?;
    let (channel, sample) = (component / picture.samples, component % picture.samples);
    let index = |z: usize| channel + channels * (z + depth * time);
    let pages = selection.slices(depth).map(|z| pages[index(z)].clone()).collect();
    Ok((stated, picture, Chosen::new(pages, (selection, depth), [sample, component, components])))
}

/// The component that is read, and the number of components, for pages of `channels` channels.
fn component(
    source_name: &str,
    stated: &Stated,
    picture: &Picture,
    channels: usize,
    selection: &Selection,
) -> Result<(usize, usize), VolumeError> {
    let count = channels.saturating_mul(picture.samples);
    let names = if has_names(stated, picture, count) { stated.names.clone() } else { Vec::new() };
    let kind = if channels == 1 { picture.kind() } else { "" };
    let there = Several::Components { count, kind: kind.to_owned(), names };
    Ok((selection.component_of(source_name, there)?, count))
}

/// Whether `stated` names the `count` components; samples of a colour have no names.
fn has_names(stated: &Stated, picture: &Picture, count: usize) -> bool {
    let is_named = |name: &String| !name.is_empty();
    count > 1 && picture.samples == 1 && stated.names.len() == count && stated.names.iter().any(is_named)
}

/// The size and type that all pages have, of which there is one at least; refuses the first page that differs.
fn alike(paths: &[PathBuf], pages: &[Page]) -> Result<Picture, VolumeError> {
    let first = &pages[0];
    match pages.iter().find(|page| !page.picture().is_like(first.picture())) {
        None => Ok(*first.picture()),
        Some(page) => {
            let [this, that] = [page.picture(), first.picture()];
            let problem = format!("{this}, but page {} has {that}", first.number);
            let place = format!("page {}", page.number);
            Err(VolumeError::Field { path: paths[page.file].clone(), place, problem })
        }
    }
}

/// Description of the first page.
enum Description {
    None,
    Ome(Vec<u8>),
    ImageJ { description: Vec<u8>, own: imagej::Own },
}

/// The pages of a file.
struct Contents {
    /// All pages but smaller copies and masks.
    pages: Vec<Page>,
    /// Pages of the file, with copies and masks.
    all: usize,
    description: Description,
    /// Pixels per unit along x and y, and the code of the unit.
    resolution: ([Option<f64>; 2], u64),
    /// Size of the file in bytes.
    length: u64,
}

impl Contents {
    /// Reads the directories of `path`, which is file `file` of the volume.
    fn read(path: &Path, file: usize, progress: &dyn Progress) -> Result<Self, VolumeError> {
        if let Some(text) = companion(path)? {
            let length = count(text.len());
            let description = Description::Ome(text);
            return Ok(Self { pages: Vec::new(), all: 0, description, resolution: ([None; 2], 1), length });
        }
        let mut tiff = Tiff::open(path)?;
        let length = tiff.length;
        let mut contents =
            Self { pages: Vec::new(), all: 0, description: Description::None, resolution: ([None; 2], 1), length };
        tiff.directories(|tiff, directory| {
            data::check_cancelled(path, progress)?;
            contents.all += 1;
            if contents.all == 1 {
                if let Some(entry) = directory.find(tag::DESCRIPTION) {
                    let text = tiff.bytes(entry, "page 1, ImageDescription")?;
                    contents.description = if ome::recognises(&text) {
                        Description::Ome(text)
                    } else if imagej::recognises(&text) {
                        Description::ImageJ { description: text, own: imagej::own(tiff, &directory)? }
                    } else {
                        Description::None
                    };
                }
                for (axis, tag) in [tag::X_RESOLUTION, tag::Y_RESOLUTION].into_iter().enumerate() {
                    if let Some(entry) = directory.find(tag) {
                        contents.resolution.0[axis] = tiff.fraction(entry, "page 1, resolution")?;
                    }
                }
                if let Some(entry) = directory.find(tag::RESOLUTION_UNIT) {
                    contents.resolution.1 = tiff.whole(entry, 0, "page 1, ResolutionUnit")?.unwrap_or(1);
                }
            }
            let mut reading = Reading { tiff, directory: &directory };
            if !reading.is_extra()? {
                let page = reading.page(file, contents.pages.last())?;
                contents.pages.push(page);
            }
            Ok(())
        })?;
        if contents.pages.is_empty() {
            let problem = format!("all {} pages are smaller copies or masks (NewSubfileType)", contents.all);
            return Err(VolumeError::Field { path: path.to_owned(), place: "header".to_owned(), problem });
        }
        Ok(contents)
    }

    /// The description of the file `path`, in its first page unless it is a companion file. No other page is read.
    fn first(path: &Path) -> Result<Vec<u8>, VolumeError> {
        if let Some(text) = companion(path)? {
            return Ok(text);
        }
        let (mut tiff, mut text) = (Tiff::open(path)?, None);
        // The error ends the list of pages.
        let ended = || VolumeError::Cancelled { source_name: path.display().to_string() };
        let read = tiff.directories(|tiff, directory| {
            let found = directory.find(tag::DESCRIPTION).map(|entry| tiff.bytes(entry, "page 1, ImageDescription"));
            text = found.transpose()?;
            Err(ended())
        });
        match (text, read) {
            (Some(text), _) => Ok(text),
            (None, Err(error)) => Err(error),
            (None, Ok(_)) => Err(ended()),
        }
    }

    /// The pages of an `ImageJ` file that states the number of its images. A stack of over 4 GiB has one directory, and
    /// its images follow each other.
    fn imagej_pages(&self, path: &Path, images: usize) -> Result<Vec<Page>, VolumeError> {
        let wrong = |problem: String| VolumeError::Field {
            path: path.to_owned(),
            place: "page 1, ImageDescription".to_owned(),
            problem,
        };
        let first = &self.pages[0];
        if images == self.pages.len() {
            return Ok(self.pages.clone());
        }
        let is_plain =
            first.coding.compression == Compression::None && !first.coding.is_tiled && !first.coding.is_planar;
        if self.pages.len() > 1 || !is_plain {
            return Err(wrong(format!("it states {images} images, but the file has {} pages", self.pages.len())));
        }
        if images > directory::MOST_PAGES {
            return Err(wrong(format!("{images} images; Relume reads at most {}", directory::MOST_PAGES)));
        }
        let start = match first.chunks {
            Chunks::Whole(start) => Some(start),
            Chunks::Listed { offsets, .. } => Tiff::open(path)?.whole(offsets, 0, "page 1, StripOffsets")?,
        };
        let start = start.ok_or_else(|| wrong("the first strip has no offset".to_owned()))?;
        let bytes = first.coding.bytes();
        let (expected, found) = (bytes.saturating_mul(count(images)), self.length.saturating_sub(start));
        if expected > found {
            return Err(VolumeError::Short { path: path.to_owned(), found, expected });
        }
        let mut coding = *first.coding;
        coding.chunk = [coding.picture.width, coding.picture.height];
        let coding = std::sync::Arc::new(coding);
        let page = |index: usize| Page {
            number: index + 1,
            coding: std::sync::Arc::clone(&coding),
            chunks: Chunks::Whole(start + bytes * count(index)),
            ..first.clone()
        };
        Ok((0..images).map(page).collect())
    }
}

/// The text of the file `path`, if it is a companion file.
fn companion(path: &Path) -> Result<Option<Vec<u8>>, VolumeError> {
    if !recognises_companion(&crate::stream::beginning(path)?) {
        return Ok(None);
    }
    let read = relume_base::input::read(path, LONGEST_COMPANION);
    let text = read.map_err(|source| VolumeError::Open { path: path.to_owned(), source })?;
    if count(text.len()) > LONGEST_COMPANION {
        let problem = format!("the description is longer than {LONGEST_COMPANION} bytes");
        return Err(VolumeError::Field { path: path.to_owned(), place: "OME-XML".to_owned(), problem });
    }
    Ok(Some(text))
}

/// The files of a volume.
struct Files<'a> {
    /// The file that was asked for.
    main: &'a Path,
    /// All files, the main one first.
    paths: Vec<PathBuf>,
    /// Pages of the other files, by their index among the files that the description names.
    opened: HashMap<usize, Contents>,
    progress: &'a dyn Progress,
}

impl Files<'_> {
    fn wrong(&self, problem: String) -> VolumeError {
        let is_companion = companion(self.main).is_ok_and(|text| text.is_some());
        let place = if is_companion { "OME-XML" } else { "page 1, OME-XML" };
        VolumeError::Field { path: self.main.to_owned(), place: place.to_owned(), problem }
    }

    /// Chooses among the planes of an OME-TIFF file with this description.
    fn ome(
        &mut self,
        contents: &Contents,
        description: &[u8],
        selection: &Selection,
    ) -> Result<(Stated, Picture, Chosen), VolumeError> {
        let source_name = self.main.display().to_string();
        let ome = Ome::read(description).map_err(|problem| self.wrong(problem))?;
        let series: Vec<Series> = ome.images.iter().enumerate().map(|(index, image)| image.series(index)).collect();
        let names: Vec<&str> = ome.images.iter().map(|image| image.name.as_str()).collect();
        let image = &ome.images[selection.series(&source_name, &series, &names)?];
        let first = image.first().map_err(|problem| self.wrong(problem))?;
        let picture = *self.page(&ome, contents, first)?.picture();
        let Picture { width, height, samples, .. } = picture;
        if [image.width, image.height] != [width, height] {
            return Err(self.wrong(format!(
                "it states {}×{} voxels, but the pages have {width}×{height}",
                image.width, image.height
            )));
        }
        let channels = image.stated.sizes[1];
        if !channels.is_multiple_of(samples) {
            let problem = format!("it states {channels} channels, but a page has {samples} of them");
            return Err(self.wrong(problem));
        }
        let (component, components) = component(&source_name, &image.stated, &picture, channels / samples, selection)?;
        let time = selection.time(&source_name, image.stated.sizes[2])?;
        let (channel, sample) = (component / samples, component % samples);
        let pages_of = |file| Ok::<_, VolumeError>(self.contents(&ome, contents, file)?.all);
        let planes = image.planes([channel, time], samples, pages_of)?.map_err(|problem| self.wrong(problem))?;
        let depth = planes.len();
        let planes = &planes[selection.slices(depth)];
        let pages = planes.iter().map(|&plane| self.page(&ome, contents, plane)).collect::<Result<Vec<_>, _>>()?;
        let picture = alike(&self.paths, &pages)?;
        let chosen = Chosen::new(pages, (selection, depth), [sample, component, components]);
        Ok((image.stated.clone(), picture, chosen))
    }

    /// The pages of a file that the description names; `None` is the file with the description.
    fn contents<'c>(
        &'c mut self,
        ome: &Ome,
        main: &'c Contents,
        file: Option<usize>,
    ) -> Result<&'c Contents, VolumeError> {
        let Some((index, named)) = file.and_then(|file| Some((file, ome.files.get(file)?))) else { return Ok(main) };
        let own = self.main.file_name().unwrap_or_default().to_string_lossy();
        let is_named = !named.name.is_empty();
        if is_named && named.name == own || !named.uuid.is_empty() && named.uuid == ome.uuid {
            return Ok(main);
        }
        if !is_named {
            return Err(self.wrong(format!("planes are in the file {:?}, whose name is not stated", named.uuid)));
        }
        if !self.opened.contains_key(&index) {
            let path = data::beside(self.main, &named.name)?;
            let mut opened = Contents::read(&path, self.paths.len(), self.progress)?;
            // Each file may have the whole description.
            opened.description = Description::None;
            self.paths.push(path);
            self.opened.insert(index, opened);
        }
        Ok(&self.opened[&index])
    }

    /// The page of a plane.
    fn page(&mut self, ome: &Ome, main: &Contents, (file, page): ome::Plane) -> Result<Page, VolumeError> {
        let contents = self.contents(ome, main, file)?;
        let found = contents.pages.binary_search_by_key(&page.saturating_add(1), |page| page.number);
        match found {
            Ok(index) => Ok(contents.pages[index].clone()),
            Err(_) if contents.all == 0 => {
                let problem = "it names no file that has the planes; Relume reads planes in TIFF files".to_owned();
                Err(self.wrong(problem))
            }
            Err(_) => {
                let problem =
                    format!("it names page {}, but the file has {} pages", page.saturating_add(1), contents.all);
                Err(self.wrong(problem))
            }
        }
    }
}
