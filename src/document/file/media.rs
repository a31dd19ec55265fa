//! Reads the materials, the transfer function and the labels of a scene file.

use super::*;

/// Name of the gradient magnitude as the second number of a shape.
const GRADIENT: &str = "gradient";

/// The factors of a picture, row by row from below, and the number of its columns.
fn painting(path: &Path) -> Result<(usize, Arc<[f32]>), String> {
    let (columns, levels) =
        relume_volume::grey_picture(path).map_err(|error| format!("shape.image: {}", chain(&error)))?;
    let rows = levels.len() / columns.max(1);
    if columns < 2 || rows < 2 {
        return Err(format!("shape.image: {} has {columns}×{rows} pixels; it must have at least 2×2", path.display()));
    }
    Ok((columns, levels.chunks(columns).rev().flatten().copied().collect()))
}

impl Text<'_> {
    pub(super) fn materials(
        &self,
        files: &BTreeMap<String, At<MaterialFile>>,
        scalars: &Scalars,
        base: &Path,
    ) -> Result<Vec<Material>, SceneError> {
        files
            .iter()
            .map(|(name, stated)| {
                let file = stated.get_ref();
                for (key, value) in [("emission", &file.emission), ("fluorescence", &file.fluorescence)] {
                    if let Some(value) = value {
                        let message = format!(
                            "materials.{name}.{key} is not supported: a picture with emission or fluorescence cannot be relit; use `reflectance`"
                        );
                        return Err(self.invalid(value, message));
                    }
                }
                let key = format!("materials.{name}.reflectance");
                let source = self.stated("reflectance", stated, file.reflectance.as_ref())?;
                let reflectance = self.spectrum(key.clone(), source, |source| source.reflectance(base))?;
                warn_above_one(&key, &reflectance);
                let mut material = Material::new(name, reflectance);
                if let Some(stated) = &file.absorption {
                    let key = format!("materials.{name}.absorption");
                    material.absorption = Some(self.spectrum(key, stated, |source| source.absorption(base))?);
                }
                material.film = file.film.as_ref().map(|film| self.film(name, film)).transpose()?;
                material.occludes = if file.xray == Some(true) { 0.0 } else { 1.0 };
                self.set(&mut material, key::MATERIAL, &format!("materials.{name}."), scalars)?;
                Ok(material)
            })
            .collect()
    }

    /// Reads the film of the material `name`.
    fn film(&self, name: &str, stated: &At<ThinFilmFile>) -> Result<ThinFilm, SceneError> {
        let file = stated.get_ref();
        let number =
            |key: &str, value: &At<f64>, range| self.number(&format!("materials.{name}.film.{key}"), value, range);
        let index = number("index", self.stated("index", stated, file.index.as_ref())?, &INDICES)?;
        let thickness_nm =
            number("thickness", self.stated("thickness", stated, file.thickness.as_ref())?, &THICKNESSES)?;
        let medium = |key: &str, value: Option<&At<f64>>| value.map_or(Ok(1.0), |value| number(key, value, &INDICES));
        let (above, below) = (medium("above", file.above.as_ref())?, medium("below", file.below.as_ref())?);
        let layers = Layers { index, thickness_nm, above, below };
        ThinFilm::new(layers, file.angle).map_err(|error| self.invalid(stated, error.to_string()))
    }

    pub(super) fn material(&self, name: &At<String>, materials: &[Material]) -> Result<usize, SceneError> {
        self.material_named(name.get_ref(), materials).map_err(|message| self.invalid(name, message))
    }

    #[expect(clippy::unused_self, reason = "reads beside `material`")]
    pub(super) fn material_named(&self, name: &str, materials: &[Material]) -> Result<usize, String> {
        materials.iter().position(|material| material.name == name).ok_or_else(|| {
            let names: Vec<_> = materials.iter().map(|material| material.name.as_str()).collect();
            format!("there is no material {name:?}; there are: {}", names.join(", "))
        })
    }

    /// Optical depth per opacity length at the peak of the material's absorption spectrum.
    pub(super) fn absorption(
        &self,
        key: &str,
        value: Option<&At<f64>>,
        material: &Material,
    ) -> Result<f64, SceneError> {
        let Some(value) = value else { return Ok(0.0) };
        let depth = self.number(key, value, &DEPTH)?;
        if depth > 0.0 && material.absorption.is_none() {
            return Err(self.invalid(value, without_absorption(key, &material.name)));
        }
        Ok(depth)
    }

    pub(super) fn opacity(&self, key: &str, value: &At<f64>, material: &Material) -> Result<f64, SceneError> {
        let opacity = self.number(key, value, &UNIT)?;
        if material.is_xray() && opacity >= 1.0 {
            let message = format!(
                "{key} = 1; the opacity of the X-ray material {} must be at least 0 and less than 1, because 1 would scatter infinite light",
                material.name
            );
            return Err(self.invalid(value, message));
        }
        Ok(opacity)
    }

    /// The terms of the transfer function, and the points of its factor by the gradient magnitude. Factors may depend on the `others`, the
    /// names of other fields; paths are relative to `base`.
    pub(super) fn transfer(
        &self,
        file: &TransferFile,
        materials: &[Material],
        (others, base): (&[&str], &Path),
    ) -> Result<(Vec<Term>, GradientFactor), SceneError> {
        let mut terms = Vec::new();
        let by_of_all = self.by(file.by.as_ref(), others)?.unwrap_or_default();
        for interval in &file.intervals {
            let material = self.material(&interval.material, materials)?;
            let [low, high] = *interval.range.get_ref();
            if !(low.is_finite() && high.is_finite() && low <= high) {
                return Err(self.invalid(
                    &interval.range,
                    format!(
                        "range = [{}, {}]; it must be two finite numbers, the lower one first",
                        readable(low),
                        readable(high)
                    ),
                ));
            }
            let ramp = self.optional("ramp", interval.ramp.as_ref(), &(0.0..=f64::MAX), 0.0)?;
            let opacity = self.opacity("opacity", &interval.opacity, &materials[material])?;
            let absorption = self.absorption("absorption", interval.absorption.as_ref(), &materials[material])?;
            let term = Term::interval(material, [low, high], ramp, opacity, absorption);
            let gradient = self.factor("gradient", interval.gradient.as_ref())?;
            let by = self.by(interval.by.as_ref(), others)?.unwrap_or_else(|| by_of_all.clone());
            let shape = interval.shape.as_ref().map(|shape| self.shape(shape, others, base)).transpose()?;
            terms.push(Term { gradient, by, shape: shape.map(Arc::new), ..term });
        }
        match (&file.opacity, &file.material) {
            (None, None) => {}
            (Some(opacity), Some(material)) => {
                let curves = self.curves(opacity, file.absorption.as_ref(), material, materials)?;
                terms.push(Term { by: by_of_all, ..curves });
            }
            (Some(alone), None) => {
                return Err(self.invalid(alone, "an opacity curve needs a `material` curve"));
            }
            (None, Some(alone)) => {
                return Err(self.invalid(alone, "a material curve needs an `opacity` curve"));
            }
        }
        if let Some(range) = &file.range {
            terms = self.stretched(&terms, range, others)?;
        }
        let all = self.factor("gradient_opacity", file.gradient_opacity.as_ref())?;
        let factors = different_factors(&terms, &all).len();
        if let Some(last) = file.intervals.last().filter(|_| factors > FACTORS) {
            let message = format!(
                "the terms have {factors} different factors by the gradient, other fields or shapes; the limit is {FACTORS}, because each group of terms with equal ones is looked up apart"
            );
            return Err(self.invalid(&last.range, message));
        }
        Ok((terms, all))
    }

    /// `terms` over the values of `range`; the field is one beside those with the names `others`.
    fn stretched(&self, terms: &[Term], range: &At<[f64; 2]>, others: &[&str]) -> Result<Vec<Term>, SceneError> {
        let [low, high] = *range.get_ref();
        relume_scene::stretched(terms, [low, high]).ok_or_else(|| {
            let message = if low < high && low.is_finite() && high.is_finite() {
                let others =
                    if others.is_empty() { String::new() } else { format!("; other fields are {}", others.join(", ")) };
                format!(
                    "transfer.range stretches intervals and curves, and this field has none with two values{others}"
                )
            } else {
                let [low, high] = [low, high].map(readable);
                format!("transfer.range = [{low}, {high}]; it must be two finite numbers, the lower one first")
            };
            self.invalid(range, message)
        })
    }

    /// Factors by the values of other fields; `None` if the file states none.
    fn by(&self, stated: Option<&ByFile>, others: &[&str]) -> Result<Option<Vec<FieldFactor>>, SceneError> {
        let factor = |(name, stated): (&String, &At<ListsFile>)| {
            let Some(place) = alike_among(others, name) else {
                let message = match others {
                    [] => format!("by.{name}: there is no other field; add [volumes.{name}]"),
                    _ => format!("by.{name}: there is no other field {name:?}; there are {}", others.join(", ")),
                };
                return Err(self.invalid(stated, message));
            };
            let pairs = Spanned::new(stated.span(), stated.get_ref().pairs());
            let points = self.points(&format!("by.{name}"), &pairs)?;
            Ok(FieldFactor { field: others[place].to_owned(), points })
        };
        stated.map(|stated| stated.iter().map(factor).collect()).transpose()
    }

    /// Points of a factor by the gradient magnitude; none if the file states none.
    fn factor(&self, key: &str, stated: Option<&At<Vec<[f64; 2]>>>) -> Result<GradientFactor, SceneError> {
        let Some(stated) = stated else { return Ok(Vec::new()) };
        let points = self.points(key, stated)?;
        match points.first().filter(|point| point.0 < 0.0) {
            Some(point) => {
                let message = format!("{key} starts at {}; a magnitude is at least 0", readable(point.0));
                Err(self.invalid(stated, message))
            }
            None => Ok(points),
        }
    }

    /// A factor by the value and a second number together.
    fn shape(&self, stated: &At<ShapeFile>, others: &[&str], base: &Path) -> Result<Shape, SceneError> {
        let file = stated.get_ref();
        let second = match file.by.as_str() {
            GRADIENT => Second::Gradient,
            name if others.contains(&name) => Second::Field(name.to_owned()),
            name => {
                let known = std::iter::once(GRADIENT).chain(others.iter().copied()).collect::<Vec<_>>().join(", ");
                return Err(self.invalid(stated, format!("shape.by = {name:?}; the second number may be: {known}")));
            }
        };
        let alone = |other: Option<&str>| match other {
            Some(other) => Err(self.invalid(stated, format!("a shape has one form; leave out `{other}`"))),
            None => Ok(()),
        };
        let is_stated = |key: bool, name: &'static str| key.then_some(name);
        let form = if let Some(polygon) = &file.polygon {
            let beside = [is_stated(file.ratio.is_some(), "ratio"), is_stated(file.image.is_some(), "image")];
            alone(beside.into_iter().flatten().next())?;
            let corners = polygon.get_ref().clone();
            if corners.len() < 3 || corners.len() > MOST_CORNERS || corners.iter().flatten().any(|it| !it.is_finite()) {
                let message = format!("a polygon has 3 to {MOST_CORNERS} corners [value, second number], all finite");
                return Err(self.invalid(polygon, message));
            }
            let is_flat = |axis: usize| corners.iter().all(|corner| corner[axis].total_cmp(&corners[0][axis]).is_eq());
            if is_flat(0) || is_flat(1) {
                return Err(self.invalid(polygon, "the corners of a polygon do not lie on a line"));
            }
            Form::Polygon { corners, soft: self.optional("shape.soft", file.soft.as_ref(), &(0.0..=0.5), SOFT)? }
        } else if let Some(ratio) = &file.ratio {
            alone(is_stated(file.image.is_some(), "image"))?;
            Form::Ratio(self.points("shape.ratio", ratio)?)
        } else if let Some(image) = &file.image {
            let range = |key: &str, range: Option<&At<[f64; 2]>>| {
                let stated = self.stated(key, stated, range)?;
                let [low, high] = *stated.get_ref();
                if low < high && low.is_finite() && high.is_finite() {
                    return Ok([low, high]);
                }
                let message = format!(
                    "{key} = [{}, {}]; it must be two finite numbers, the lower one first",
                    readable(low),
                    readable(high)
                );
                Err(self.invalid(stated, message))
            };
            let (values, second) = (range("values", file.values.as_ref())?, range("second", file.second.as_ref())?);
            let (columns, heights) = painting(&base.join(image)).map_err(|message| self.invalid(stated, message))?;
            Form::Painted(Painting { file: image.clone(), values, second, columns, heights })
        } else {
            return Err(self.invalid(stated, "a shape has a `polygon`, a `ratio` or an `image`"));
        };
        let needless = [
            is_stated(file.soft.is_some() && file.polygon.is_none(), "soft"),
            is_stated(file.values.is_some() && file.image.is_none(), "values"),
            is_stated(file.second.is_some() && file.image.is_none(), "second"),
        ];
        alone(needless.into_iter().flatten().next())?;
        Ok(Shape { second, form })
    }

    /// Points of a factor.
    fn points(&self, key: &str, stated: &At<Vec<[f64; 2]>>) -> Result<Vec<(f64, f64)>, SceneError> {
        let points = self.curve("a factor", stated, &UNIT)?;
        if points.len() > GRADIENT_POINTS {
            let message = format!("{key} has {} points; the limit is {GRADIENT_POINTS}", points.len());
            return Err(self.invalid(stated, message));
        }
        match points.windows(2).find(|pair| pair[0].0 >= pair[1].0) {
            Some(pair) => Err(self.invalid(stated, descends(pair[0].0, pair[1].0))),
            None => Ok(points),
        }
    }

    /// Points of a curve of the transfer function, with heights in `range`.
    pub(super) fn curve(
        &self,
        what: &str,
        stated: &At<Vec<[f64; 2]>>,
        range: &RangeInclusive<f64>,
    ) -> Result<Vec<(f64, f64)>, SceneError> {
        let points: Vec<(f64, f64)> = stated.get_ref().iter().map(|&[value, height]| (value, height)).collect();
        if points.is_empty() {
            return Err(self.invalid(stated, "a curve needs at least one point"));
        }
        if let Some(point) = points.iter().find(|point| !(point.0.is_finite() && range.contains(&point.1))) {
            let [value, height, most] = [point.0, point.1, *range.end()].map(readable);
            let message = format!(
                "the point [{value}, {height}] is invalid: the value must be finite, and {what} from 0 to {most}"
            );
            return Err(self.invalid(stated, message));
        }
        match points.windows(2).find(|pair| pair[1].0 < pair[0].0) {
            Some(pair) => Err(self.invalid(stated, descends(pair[0].0, pair[1].0))),
            None => Ok(points),
        }
    }

    pub(super) fn curves(
        &self,
        opacity: &At<Vec<[f64; 2]>>,
        absorption: Option<&At<Vec<[f64; 2]>>>,
        material: &At<Vec<(f64, String)>>,
        materials: &[Material],
    ) -> Result<Term, SceneError> {
        let points = self.curve("an opacity", opacity, &UNIT)?;
        let depths = absorption.map(|stated| self.curve("an optical depth", stated, &DEPTH)).transpose()?;
        let depths = depths.unwrap_or_default();
        if material.get_ref().is_empty() {
            return Err(self.invalid(material, "a curve needs at least one point"));
        }
        let mut curve = Vec::new();
        for (value, name) in material.get_ref() {
            let index = self.material_named(name, materials).map_err(|message| self.invalid(material, message))?;
            if materials[index].is_xray() && points.iter().any(|point| point.1 >= 1.0) {
                return Err(self.invalid(
                    opacity,
                    format!("transfer.opacity = 1; the opacity of the X-ray material {name} must be less than 1"),
                ));
            }
            curve.push((*value, index));
        }
        if let Some(stated) = absorption.filter(|_| depths.iter().any(|point| point.1 > 0.0))
            && curve.iter().all(|&(_, index)| materials[index].absorption.is_none())
        {
            let names: Vec<&str> = material.get_ref().iter().map(|(_, name)| name.as_str()).collect();
            return Err(self.invalid(stated, without_absorption("absorption", &names.join(", "))));
        }
        if let Some(point) = curve.iter().find(|point| !point.0.is_finite()) {
            return Err(self.invalid(material, format!("the value {} of the material curve is not finite", point.0)));
        }
        if let Some(pair) = curve.windows(2).find(|pair| pair[0].0 >= pair[1].0) {
            return Err(self.invalid(material, descends(pair[0].0, pair[1].0)));
        }
        let material = MaterialCurve(curve);
        Ok(Term {
            ramp: None,
            opacity: points,
            absorption: depths,
            material,
            gradient: Vec::new(),
            by: Vec::new(),
            shape: None,
        })
    }

    /// The declared labels, and the entry of all others.
    pub(super) fn label_entries(
        &self,
        files: &BTreeMap<String, At<LabelFile>>,
        materials: &[Material],
    ) -> Result<Declared, SceneError> {
        let mut entries: BTreeMap<i64, LabelEntry> = BTreeMap::new();
        let mut others = None;
        for (key, value) in files {
            if entries.len() == MOST_LABELS {
                let message = format!("{} labels are declared; the limit is {MOST_LABELS}", files.len());
                return Err(self.invalid(value, message));
            }
            let file = value.get_ref();
            if key == OTHERS {
                others = Some(self.other_labels(value, materials)?);
                continue;
            }
            let label = key.parse::<i64>().ok().filter(|&label| label >= 0).ok_or_else(|| {
                self.invalid(
                    value,
                    format!(
                        "labels.{key}: a label is a whole number from 0 to {}, or {OTHERS:?} for all others",
                        i64::MAX
                    ),
                )
            })?;
            if entries.contains_key(&label) {
                return Err(self.invalid(value, format!("labels.{key}: label {label} is declared twice")));
            }
            if let Some(several) = &file.materials {
                let message = format!("labels.{key}: one label has one `material`; `materials` is for labels.{OTHERS}");
                return Err(self.invalid(several, message));
            }
            let name = file.name.clone().unwrap_or_else(|| key.clone());
            let entry = match &file.transfer {
                Some(transfer) => self.label_by_value((label, name), (key, file), transfer, materials)?,
                None => {
                    let material = self.material(self.stated("material", value, file.material.as_ref())?, materials)?;
                    let [opacity, absorption] = self.label_depths(key, value, &materials[material])?;
                    LabelEntry { label, name, material, opacity, absorption, terms: Vec::new() }
                }
            };
            entries.insert(label, entry);
        }
        Ok(Declared { entries, others })
    }

    /// A label that shows different media at different values.
    fn label_by_value(
        &self,
        (label, name): (i64, String),
        (key, file): (&str, &LabelFile),
        stated: &At<TransferFile>,
        materials: &[Material],
    ) -> Result<LabelEntry, SceneError> {
        if file.material.is_some() || file.opacity.is_some() || file.absorption.is_some() {
            let message = format!(
                "labels.{key} has a `transfer`, which states its materials and opacities by value; remove its own `material`, `opacity` and `absorption`"
            );
            return Err(self.invalid(stated, message));
        }
        let (terms, all) = self.transfer(stated.get_ref(), materials, (&[], Path::new("")))?;
        if !all.is_empty() || terms.iter().any(|term| !term.gradient.is_empty() || term.shape.is_some()) {
            let message = format!("labels.{key}.transfer: labels have no factors by the gradient, and no shapes");
            return Err(self.invalid(stated, message));
        }
        let highest =
            |of: fn(&Term) -> &Vec<(f64, f64)>| terms.iter().flat_map(of).map(|point| point.1).fold(0.0, f64::max);
        let (opacity, absorption) = (highest(|term| &term.opacity), highest(|term| &term.absorption));
        // A legend shows the most opaque one.
        let most = |term: &Term| term.opacity.iter().map(|point| point.1).fold(0.0, f64::max);
        let first =
            terms.iter().reduce(|most_opaque, term| if most(term) > most(most_opaque) { term } else { most_opaque });
        let Some(material) = first.and_then(|term| term.material.0.first()).map(|point| point.1) else {
            let message =
                format!("labels.{key}.transfer shows nothing; write `intervals`, or `opacity` and `material`");
            return Err(self.invalid(stated, message));
        };
        Ok(LabelEntry { label, name, material, opacity, absorption, terms })
    }

    fn label_depths(&self, key: &str, value: &At<LabelFile>, material: &Material) -> Result<[f64; 2], SceneError> {
        let file = value.get_ref();
        let stated = self.stated("opacity", value, file.opacity.as_ref())?;
        let opacity = self.opacity(&format!("labels.{key}.opacity"), stated, material)?;
        let absorption = format!("labels.{key}.absorption");
        Ok([opacity, self.absorption(&absorption, file.absorption.as_ref(), material)?])
    }

    /// Material, opacity and absorption of the labels without an entry of their own, in turn.
    fn other_labels(
        &self,
        value: &At<LabelFile>,
        materials: &[Material],
    ) -> Result<Vec<(usize, [f64; 2])>, SceneError> {
        let file = value.get_ref();
        let listed = self.stated("materials", value, file.materials.as_ref())?;
        if file.material.is_some() || file.name.is_some() || file.transfer.is_some() || listed.get_ref().is_empty() {
            let message = format!(
                "labels.{OTHERS} has `materials`, the names of at least one material that its labels take in turn, and neither `material` \
                 nor `name` nor `transfer`"
            );
            return Err(self.invalid(value, message));
        }
        let of_name = |name: &String| {
            let material = self.material(&Spanned::new(listed.span(), name.clone()), materials)?;
            Ok((material, self.label_depths(OTHERS, value, &materials[material])?))
        };
        listed.get_ref().iter().map(of_name).collect()
    }
}

/// Declared labels, before the label map is known.
pub(super) struct Declared {
    entries: BTreeMap<i64, LabelEntry>,
    /// Material, opacity and absorption of labels without an entry, in turn; `None` if these follow the transfer function.
    others: Option<Vec<(usize, [f64; 2])>>,
}

impl Declared {
    /// The entries of the labels of a map, ascending.
    ///
    /// # Errors
    ///
    /// [`VolumeError::Layout`] for a map with others than labels, or with too many.
    pub(super) fn of_map(mut self, map: &Volume) -> Result<Vec<LabelEntry>, VolumeError> {
        let Some(others) = &self.others else { return Ok(self.entries.into_values().collect()) };
        map.require_voxels("a label map")?;
        // The background and the labels.
        let counts = map.label_counts(MOST_LABELS + 1).map_err(|problem| map.no_labels(problem))?;
        let labels: Vec<i64> = counts.keys().copied().filter(|&label| !is_background(label, &counts)).collect();
        // Labels with an entry count, so that those behind them keep their materials.
        for (label, &(material, [opacity, absorption])) in labels.into_iter().zip(others.iter().cycle()) {
            if self.entries.contains_key(&label) {
                continue;
            }
            let preset = map.presets.labels.iter().find(|preset| preset.value == label);
            let name = preset.map(|preset| preset.name.clone()).filter(|name| !name.is_empty());
            let name = name.unwrap_or_else(|| format!("label_{label}"));
            self.entries.insert(label, LabelEntry { label, name, material, opacity, absorption, terms: Vec::new() });
        }
        Ok(self.entries.into_values().collect())
    }
}
