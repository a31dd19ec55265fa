//! Reads the lights, the dial, the mix and the camera of a scene file.

use super::*;

/// Problem of a light of `kind` with or without a direction and a position, if they do not fit it.
fn misplaced(kind: LightKind, has_direction: bool, has_position: bool) -> String {
    let (name, needed) = (kind.name(), kind.vector());
    let given = [("direction", has_direction), ("position", has_position)];
    let problem = match given.into_iter().find(|&(key, given)| given && needed != Some(key)) {
        Some((key, _)) => {
            let other = LightKind::with_vector(key).unwrap_or_default();
            let default = if kind == LightKind::default() { " (the default)" } else { "" };
            format!(
                "has a `{key}`, but its kind is {name}{default}, which has none; add kind = \"{other}\", or remove `{key}`"
            )
        }
        None if needed == Some("position") => {
            "is a point light without a `position`; add one in world units, such as position = [10, 20, 30]".to_owned()
        }
        None => {
            "is a directional light without a `direction`; add the direction towards the light, such as direction = \
                 [-0.4, -0.7, -0.6]"
                .to_owned()
        }
    };
    format!("{problem} (a directional light has a `direction`, a point light a `position`, other lights neither)")
}

impl Text<'_> {
    /// The lights, and the names of the dark lights, whose intensity is 0. Dark lights get intensity 1, for sliders,
    /// the dial and `--light`, and are switched off when the scene opens.
    pub(super) fn lights(
        &self,
        files: &BTreeMap<String, At<LightFile>>,
        scalars: &Scalars,
        base: &Path,
    ) -> Result<(Vec<SceneLight>, BTreeSet<String>), SceneError> {
        let mut dark = BTreeSet::new();
        let lights = files
            .iter()
            .map(|(name, stated)| {
                let file = stated.get_ref();
                let source = self.stated("spectrum", stated, file.spectrum.as_ref())?;
                let spectrum = self.spectrum(format!("lights.{name}.spectrum"), source, |source| source.light(base))?;
                warn_below_zero(&format!("lights.{name}.spectrum"), &spectrum);
                let vector = match (&file.direction, &file.position) {
                    (Some(direction), None) if file.kind.vector() == Some("direction") => {
                        Some(self.direction(&format!("lights.{name}.direction"), direction)?)
                    }
                    (None, Some(position)) if file.kind.vector() == Some("position") => {
                        Some(self.vector(&format!("lights.{name}.position"), position)?)
                    }
                    _ => None,
                };
                let given = usize::from(file.direction.is_some()) + usize::from(file.position.is_some());
                let fits = given == usize::from(vector.is_some());
                let placement = Placement::of(file.kind, vector).filter(|_| fits).ok_or_else(|| {
                    let problem = misplaced(file.kind, file.direction.is_some(), file.position.is_some());
                    self.invalid(stated, format!("lights.{name} {problem}"))
                })?;
                let mut light = SceneLight { placement, ..SceneLight::new(name, spectrum) };
                self.set(&mut light, key::LIGHT, &format!("lights.{name}."), scalars)?;
                if light.intensity == 0.0 {
                    dark.insert(name.clone());
                    light.intensity = 1.0;
                }
                Ok(light)
            })
            .collect::<Result<_, _>>()?;
        Ok((lights, dark))
    }

    /// The regular polygon of `lights` with the changes of the file.
    pub(super) fn dial(&self, file: &DialFile, lights: &[SceneLight]) -> Result<Dial, SceneError> {
        let mut dial = Dial::regular(lights.iter().map(|light| light.name.as_str()));
        dial.normalise = file.normalise.unwrap_or(dial.normalise);
        dial.master = self.optional("dial.master", file.master.as_ref(), &INTENSITY, dial.master)?;
        for (name, stated) in &file.nodes {
            let place = DVec2::from_array(*stated.get_ref());
            let node = dial.node_mut(name).map_err(|message| self.invalid(stated, format!("dial.nodes.{message}")))?;
            if !place.is_finite() {
                return Err(self.invalid(stated, format!("dial.nodes.{name} has a component that is not finite")));
            }
            node.place = place;
        }
        for name in &file.off {
            dial.node_mut(name.get_ref()).map_err(|message| self.invalid(name, format!("dial.off: {message}")))?.on =
                false;
        }
        if let Some(old) = file.situations.first() {
            if !file.presets.is_empty() {
                return Err(self.invalid(&old.hand, "dial.situations is now called dial.presets; keep one of the two"));
            }
            tracing::warn!("dial.situations is now called dial.presets");
        }
        for stated in file.presets.iter().chain(&file.situations) {
            let key = format!("dial.presets, {}", stated.name);
            let hand = self.hand(&key, &stated.hand, &mut dial)?;
            for name in stated.off.iter().chain(&stated.on) {
                dial.node_mut(name.get_ref()).map_err(|message| self.invalid(name, format!("{key}: {message}")))?;
            }
            let names = |of: &[At<String>]| of.iter().map(|name| name.get_ref().clone()).collect();
            let (off, on) = (names(&stated.off), names(&stated.on));
            let (name, caption) = (stated.name.clone(), stated.caption.clone());
            dial.presets.push(DialPreset { name, caption, hand, off, on });
        }
        Ok(dial)
    }

    /// Position of a hand on `dial`, the value of `key`.
    fn hand(&self, key: &str, stated: &At<HandFile>, dial: &mut Dial) -> Result<DVec2, SceneError> {
        match stated.get_ref() {
            HandFile::Node(name) => {
                let node = dial.node_mut(name).map_err(|message| self.invalid(stated, format!("{key}: {message}")))?;
                Ok(node.place)
            }
            HandFile::Place(place) if !place.iter().all(|part| part.is_finite()) => {
                Err(self.invalid(stated, format!("{key}: the position of the hand is not finite")))
            }
            HandFile::Place(place) => Ok(DVec2::from_array(*place)),
        }
    }

    /// Initial mix of the scene's `lights`; `dark` lights are off.
    pub(super) fn mix(
        &self,
        file: &MixFile,
        (lights, dial): (&[SceneLight], &mut Dial),
        dark: &BTreeSet<String>,
    ) -> Result<LightState, SceneError> {
        let names = || lights.iter().map(|light| light.name.as_str()).collect::<Vec<_>>().join(", ");
        let index = |name: &str| {
            let found = lights.iter().position(|light| light.name == name);
            found.ok_or_else(|| format!("there is no light {name:?}; there are: {}", names()))
        };
        let named = |key: &str, name: &At<String>| {
            index(name.get_ref()).map_err(|message| self.invalid(name, format!("mix.{key}: {message}")))
        };
        let mut state = LightState { mixing: file.by, normalise: file.normalise, ..LightState::stated(lights.len()) };
        state.master = self.optional("mix.master", file.master.as_ref(), &INTENSITY, 1.0)?;
        for (name, weight) in &file.weights {
            let light = index(name).map_err(|message| self.invalid(weight, format!("mix.weights: {message}")))?;
            state.sliders[light].weight = self.number(&format!("mix.weights.{name}"), weight, &INTENSITY)?;
        }
        for (slider, light) in state.sliders.iter_mut().zip(lights) {
            slider.on = !dark.contains(&light.name);
        }
        for name in &file.off {
            state.sliders[named("off", name)?].on = false;
        }
        for name in &file.on {
            state.sliders[named("on", name)?].on = true;
        }
        state.solo = file.solo.as_ref().map(|name| named("solo", name)).transpose()?;
        if let Some(hand) = &file.hand {
            state.hand = self.hand("mix.hand", hand, dial)?;
        }
        Ok(state)
    }

    /// The camera, before its scalar keys are set.
    pub(super) fn camera(&self, file: &CameraFile, scalars: &Scalars) -> Result<Camera, SceneError> {
        let stated = |name: &str| scalars.get(&format!("camera.{name}"));
        let mut camera = Camera::default();
        match (file.projection, stated("fov"), stated("height")) {
            (ProjectionFile::Perspective, _, None) => {}
            (ProjectionFile::Orthographic, None, _) => camera.projection = Projection::Orthographic { height: None },
            (ProjectionFile::Perspective, _, Some(key)) | (ProjectionFile::Orthographic, Some(key), _) => {
                return Err(self.invalid(key, "a perspective camera has a `fov` (vertical, in degrees), an orthographic one a `height` (in world units)"));
            }
        }
        if let Some(up) = &file.up {
            camera.up = self.direction("camera.up", up)?;
        }
        match (&file.position, &file.target, &mut camera.aim) {
            (Some(position), Some(target), aim) => {
                if let Some(key) = &file.around {
                    return Err(self.invalid(key, "a camera with a `position` and a `target` has no `around`"));
                }
                let orbit = [stated("azimuth"), stated("elevation")].into_iter().flatten().map(At::span);
                if let Some(place) = orbit.chain(file.fill.as_ref().map(At::span)).next() {
                    let message = "a camera with a `position` and a `target` has no `azimuth`, `elevation` or `fill`";
                    return Err(self.refuse(place.start, message.to_owned()));
                }
                *aim = Aim::LookAt {
                    position: self.vector("camera.position", position)?,
                    target: self.vector("camera.target", target)?,
                };
            }
            (None, None, Aim::Orbit { fill, front, around, .. }) => {
                *fill = file.fill.as_ref().map_or(Ok(*fill), |fill| self.fill(fill))?;
                *front = file.front.as_ref().map_or(Ok(*front), |front| self.direction("camera.front", front))?;
                *around = file.around.as_ref().map(|around| self.around(around)).transpose()?;
            }
            (None, None, Aim::LookAt { .. }) => {}
            (Some(key), None, _) | (None, Some(key), _) => {
                return Err(self.invalid(key, "a camera needs both `position` and `target`, or neither"));
            }
        }
        Ok(camera)
    }

    /// The fill of an orbiting camera.
    fn fill(&self, fill: &At<FillFile>) -> Result<Fill, SceneError> {
        let found = match fill.get_ref() {
            FillFile::One(fraction) => Some(Fill::of(*fraction)),
            FillFile::ByAspect(pairs) => Fill::by_aspect(pairs),
        };
        let found = found.filter(|fill| fill.pairs().iter().all(|pair| Fill::RANGE.contains(&pair[1])));
        found.ok_or_else(|| {
            let message = format!(
                "camera.fill must be {}, or up to {} pairs of an ascending aspect ratio (width / height) and such a \
                 number, [[0.75, 0.9], [1.5, 1]]",
                key::numbers([*Fill::RANGE.start(), *Fill::RANGE.end()]),
                Fill::MOST
            );
            self.invalid(fill, message)
        })
    }

    /// The box of an orbiting camera.
    fn around(&self, around: &At<[[f64; 3]; 2]>) -> Result<[DVec3; 2], SceneError> {
        let corners = around.get_ref().map(DVec3::from_array);
        let [low, high] = corners;
        if low.is_finite() && high.is_finite() && low.cmplt(high).all() {
            return Ok(corners);
        }
        let message = "camera.around must be two opposite corners of a box in the world, [[x, y, z], [x, y, z]], the \
                       smaller numbers first";
        Err(self.invalid(around, message))
    }
}
