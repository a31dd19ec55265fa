//! Recorded input: a file of commands that drives the viewer without a user.
//!
//! Each line holds a command and its arguments, separated by spaces; `#` starts a comment. Each command takes a frame.
//! The
//! commands are listed in `docs/VIEW.md`.

use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::Arc;

use glam::{DVec2, DVec3};

use super::action::Action;
use super::layout::{Arrange, Dock, Note, Tab};
use crate::document::Source;
use crate::document::design::{Side, Step};
use crate::document::moves::{self, Move};
use crate::document::{Edit, State};
use crate::input;
use crate::measure::{Goal, Preset};
use crate::palette::Target;
use crate::scene::key::Named as _;
use crate::scene::{Backdrop, FIELDS, Form, Interval, SOFT, Second, Shape, Tone};
use crate::spectrum::deficiency::Deficiency;
use crate::spectrum::observer::Observer;
use crate::spectrum::srgb_code;

/// Largest size of a script, in bytes.
const LONGEST: u64 = 1 << 20;

/// Reason why a script cannot run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ScriptError {
    /// The file cannot be read.
    #[error("cannot read the script {}", path.display())]
    Read {
        /// File.
        path: PathBuf,
        /// Cause.
        source: std::io::Error,
    },
    /// Invalid line.
    #[error("{at}: {message}")]
    Line {
        /// `file:line`.
        at: String,
        /// Error message.
        message: String,
    },
}

impl ScriptError {
    /// Name for programs; it does not change between versions.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::Read { .. } => "script-not-readable",
            Self::Line { .. } => "script-line-invalid",
        }
    }
}

/// Parsed script.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Script {
    /// Name in error messages.
    name: String,
    /// Commands with their line numbers.
    commands: Vec<(usize, Command)>,
}

/// Command of a script.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Command {
    /// Draws this many frames.
    Frames(u32),
    /// Draws frames until no work is left.
    Settle,
    /// Action that refers to no name in the scene.
    Do(Action),
    /// Changes an interval of the transfer function, by its index: from, to, ramp, opacity.
    Interval(usize, [f64; 4]),
    /// Edit of an object of the scene, by its name.
    Named(About, String),
    /// Clip planes in short, in place of all.
    Clip(Vec<String>),
    /// A movement of the camera.
    Camera(Move),
    /// Probes a pixel, given as fractions of the picture, until the probe is complete.
    Probe(DVec2),
    /// Adds an end of the measuring line at a pixel, given as fractions of the picture, and waits for its depth.
    Ruler(DVec2),
    /// Sets a standard spectrum for the named material or light.
    Spectrum(Side, String, String),
    /// Resizes the window, in pixels.
    Size([u32; 2]),
    /// Input event.
    Input(Input),
}

/// Edit of a light, node, dial preset, material or label, without its name.
#[derive(Clone, Debug, PartialEq)]
#[expect(missing_docs, reason = "each variant maps to the edit of its name")]
pub enum About {
    Weight(f64),
    On(bool),
    Solo,
    HandOnNode,
    NodePlace(DVec2),
    NodeOn(bool),
    DialPreset,
    /// New name of the dial preset.
    Rename(String),
    Forget,
    /// New interval of the transfer function with this material: from, to, ramp, opacity.
    AddInterval([f64; 4]),
    /// Material of the interval with this index.
    IntervalMaterial(usize),
    /// Opacity of the label.
    LabelOpacity(f64),
    /// Part of the scattering of the material that occludes.
    Occludes(f64),
    /// Hides the field, or shows it again.
    Hidden(bool),
}

/// Mouse and keyboard input; positions are in points of the window.
#[derive(Clone, Debug, PartialEq)]
pub enum Input {
    /// Moves the pointer to this position.
    Pointer(f32, f32),
    /// Presses or releases the primary button.
    Button(bool),
    /// Turns the wheel by this many lines.
    Scroll(f32),
    /// Presses and releases a key, by its name.
    Key(String),
    /// Drops a file on the window.
    Drop(PathBuf),
}

impl Command {
    /// Whether the command needs an open scene.
    #[must_use]
    pub fn is_about_a_scene(&self) -> bool {
        match self {
            Self::Interval(..)
            | Self::Named(..)
            | Self::Clip(_)
            | Self::Camera(_)
            | Self::Probe(_)
            | Self::Ruler(_)
            | Self::Spectrum(..) => true,
            Self::Do(action) => !matches!(
                action,
                Action::Open(_)
                    | Action::SaveWindow(_)
                    | Action::Panels(_)
                    | Action::Arrange(_)
                    | Action::Palette(_)
                    | Action::Restart
                    | Action::GiveUp
                    | Action::GiveUpPage
                    | Action::Dismiss(_)
            ),
            Self::Frames(_) | Self::Settle | Self::Size(_) | Self::Input(_) => false,
        }
    }
}

impl Script {
    /// Reads the script file `path`.
    ///
    /// # Errors
    ///
    /// [`ScriptError`].
    pub fn read(path: &Path) -> Result<Self, ScriptError> {
        let read = |source| ScriptError::Read { path: path.to_owned(), source };
        let bytes = input::read(path, LONGEST).map_err(read)?;
        let text = String::from_utf8(bytes).map_err(|error| read(std::io::Error::other(error)))?;
        Self::parse(&path.display().to_string(), &text)
    }

    /// Parses `text`; `name` is used in error messages.
    ///
    /// # Errors
    ///
    /// [`ScriptError::Line`].
    pub fn parse(name: &str, text: &str) -> Result<Self, ScriptError> {
        let mut commands = Vec::new();
        for (number, line) in (1..).zip(text.lines()) {
            let words: Vec<&str> = line.split_whitespace().take_while(|word| !is_comment(word)).collect();
            if let Some((&verb, rest)) = words.split_first() {
                let at = format!("{name}:{number}");
                let command = command(verb, rest).map_err(|message| ScriptError::Line { at, message })?;
                commands.push((number, command));
            }
        }
        Ok(Self { name: name.to_owned(), commands })
    }

    /// Returns the command `index`, counted from 0; `None` after the last.
    #[must_use]
    pub fn command(&self, index: usize) -> Option<&Command> {
        self.commands.get(index).map(|(_, command)| command)
    }

    /// Creates the error for the command `index`.
    #[must_use]
    pub fn wrong(&self, index: usize, message: String) -> ScriptError {
        let line = self.commands.get(index).map_or(0, |(line, _)| *line);
        ScriptError::Line { at: format!("{}:{line}", self.name), message }
    }
}

/// Whether `word` begins a comment; `#rrggbb` is a colour.
fn is_comment(word: &str) -> bool {
    let is_colour = |rest: &str| rest.len() == 6 && rest.bytes().all(|letter| letter.is_ascii_hexdigit());
    word.strip_prefix('#').is_some_and(|rest| !is_colour(rest))
}

fn command(verb: &str, rest: &[&str]) -> Result<Command, String> {
    let text = || rest.join(" ");
    let file = || Some(PathBuf::from(text())).filter(|_| !rest.is_empty()).ok_or(format!("{verb} FILE"));
    let name = || Some(text()).filter(|_| !rest.is_empty()).ok_or(format!("{verb} NAME"));
    let edit = |edit: Edit| Command::Do(Action::Edit(edit));
    Ok(match verb {
        "frames" => Command::Frames(numbers::<u32, 1>(verb, rest)?[0]),
        "settle" => Command::Settle,
        "light" => {
            let (weight, name) = rest.split_last().ok_or("light NAME WEIGHT")?;
            let weight = weight.parse().map_err(|_| format!("{weight} is not a number: light NAME WEIGHT"))?;
            Command::Named(About::Weight(weight), name.join(" "))
        }
        "on" | "off" => Command::Named(About::On(verb == "on"), name()?),
        "solo" => Command::Named(About::Solo, name()?),
        "all" => edit(Edit::Solo(None)),
        "hand" => edit(Edit::Hand(numbers(verb, rest)?.into())),
        "node" => Command::Named(About::HandOnNode, name()?),
        "place" => {
            let (name, place) = rest.split_at_checked(rest.len().saturating_sub(2)).unwrap_or_default();
            Command::Named(About::NodePlace(numbers(verb, place)?.into()), name.join(" "))
        }
        "take" | "leave" => Command::Named(About::NodeOn(verb == "take"), name()?),
        "preset" | "situation" => {
            if verb == "situation" {
                tracing::warn!("the command situation is now called preset");
            }
            Command::Named(About::DialPreset, name()?)
        }
        "keep" => edit(Edit::Keep(name()?)),
        "rename" => {
            let (old, new) = text()
                .split_once(" to ")
                .map(|(old, new)| (old.to_owned(), new.to_owned()))
                .ok_or("rename NAME to NEW")?;
            Command::Named(About::Rename(new), old)
        }
        "forget" => Command::Named(About::Forget, name()?),
        "tour" => match rest {
            [file @ .., frames] if !file.is_empty() => {
                Command::Do(Action::SaveTour(Some(file.join(" ").into()), numbers::<u16, 1>(verb, &[frames])?[0]))
            }
            _ => Command::Do(Action::Tour(Some(numbers::<f64, 1>(verb, rest)?[0]))),
        },
        "master" => edit(Edit::Master(numbers::<f64, 1>(verb, rest)?[0])),
        "interval" => match rest {
            ["add", name @ .., from, to, ramp, opacity] if !name.is_empty() => {
                Command::Named(About::AddInterval(numbers(verb, &[from, to, ramp, opacity])?), name.join(" "))
            }
            ["remove", index] => edit(Edit::RemoveTerm(numbers::<usize, 1>(verb, &[index])?[0])),
            [index, "material", name @ ..] if !name.is_empty() => {
                Command::Named(About::IntervalMaterial(numbers::<usize, 1>(verb, &[index])?[0]), name.join(" "))
            }
            [index, "gradient", "off"] => edit(Edit::TermGradient(numbers::<usize, 1>(verb, &[index])?[0], Vec::new())),
            [index, "gradient", points @ ..] => {
                edit(Edit::TermGradient(numbers::<usize, 1>(verb, &[index])?[0], factor_points(verb, points)?))
            }
            [index, "polygon", "off"] => edit(Edit::TermShape(numbers::<usize, 1>(verb, &[index])?[0], None)),
            [index, "polygon", corners @ ..] => {
                let corners = factor_points(verb, corners)?.into_iter().map(|(value, magnitude)| [value, magnitude]);
                let form = Form::Polygon { corners: corners.collect(), soft: SOFT };
                let shape = Arc::new(Shape { second: Second::Gradient, form });
                edit(Edit::TermShape(numbers::<usize, 1>(verb, &[index])?[0], Some(shape)))
            }
            [index, numbers_of_it @ ..] => {
                Command::Interval(numbers::<usize, 1>(verb, &[index])?[0], numbers(verb, numbers_of_it)?)
            }
            [] => return Err("interval INDEX FROM TO RAMP OPACITY".to_owned()),
        },
        "gradient" => match rest {
            ["off"] => edit(Edit::GradientOpacity(Vec::new())),
            points => edit(Edit::GradientOpacity(factor_points(verb, points)?)),
        },
        "label" => {
            let (opacity, name) = rest.split_last().ok_or("label NAME OPACITY")?;
            Command::Named(About::LabelOpacity(numbers::<f64, 1>(verb, &[opacity])?[0]), name.join(" "))
        }
        "occludes" => {
            let (part, name) = rest.split_last().ok_or("occludes MATERIAL PART")?;
            Command::Named(About::Occludes(numbers::<f64, 1>(verb, &[part])?[0]), name.join(" "))
        }
        "hide" | "show" => Command::Named(About::Hidden(verb == "hide"), name()?),
        "exposure" if matches!(rest, ["auto"]) => edit(Edit::Exposure(None)),
        "exposure" => edit(Edit::Exposure(Some(numbers::<f64, 1>(verb, rest)?[0]))),
        "backdrop" => edit(Edit::Backdrop(Backdrop::of_name(&text()).ok_or("backdrop none, or backdrop dark")?)),
        "tone" => edit(Edit::Tone(Tone::of_name(&text()).ok_or("tone linear, or tone soft")?)),
        "normalise" => edit(Edit::Normalise(switch(verb, rest)?)),
        "vision" | "sees" => {
            if verb == "sees" {
                tracing::warn!("the command sees is now called vision, and `all` is now called `normal`");
            }
            let found = Deficiency::of_name(&text());
            if found.is_none() && !matches!(rest, ["normal" | "all"]) {
                return Err("write vision normal, vision protan, vision deutan or vision tritan".to_owned());
            }
            edit(Edit::Deficiency(found))
        }
        "observer" => {
            let found = Observer::of_name(&text());
            edit(Edit::Observer(found.ok_or("write observer 1931 or observer 1964")?))
        }
        "crop" => match rest {
            ["off"] => edit(Edit::Crop(None)),
            ["reset"] => edit(Edit::ResetCrop),
            _ => {
                let [x0, x1, y0, y1, z0, z1] = numbers(verb, rest)?;
                edit(Edit::Crop(Some([DVec3::new(x0, y0, z0), DVec3::new(x1, y1, z1)])))
            }
        },
        "field" => match rest {
            [index, low, high] => {
                let [low, high] = numbers(verb, &[low, high])?;
                let [index] = numbers(verb, &[index])?;
                if !(low < high && index < FIELDS) {
                    return Err(format!(
                        "field {index} {low} {high}: the lower value comes first, and a field is 0 to {}",
                        FIELDS - 1
                    ));
                }
                edit(Edit::FieldRange(index, [low, high]))
            }
            _ => return Err("write field INDEX LOW HIGH; 0 is the volume".to_owned()),
        },
        "clip" => match rest {
            ["off"] => Command::Clip(Vec::new()),
            [_, ..] => Command::Clip(rest.iter().map(|&plane| plane.to_owned()).collect()),
            [] => return Err("write clip off, or planes such as clip z:50% -x:12".to_owned()),
        },
        "adapt" => edit(Edit::Adapt(switch(verb, rest)?)),
        "orbit" => {
            let [right, up] = numbers(verb, rest)?;
            Command::Camera(Move::Orbit { right, up })
        }
        "pan" => {
            let [right, up] = numbers(verb, rest)?;
            Command::Camera(Move::Pan { right, up })
        }
        "dolly" => Command::Camera(Move::Dolly(numbers::<f64, 1>(verb, rest)?[0])),
        "roll" => Command::Camera(Move::Roll(numbers::<f64, 1>(verb, rest)?[0])),
        "axis" => {
            let sides = moves::Side::ALL.map(|side| (format!("{side:?}").to_lowercase(), side));
            let found = sides.iter().find(|(name, _)| *name == text());
            let names = || sides.each_ref().map(|(name, _)| name.as_str()).join(", ");
            let (_, side) = found.ok_or_else(|| format!("{verb} SIDE, one of: {}", names()))?;
            Command::Camera(Move::Axis(*side))
        }
        "projection" => Command::Camera(Move::Projection),
        "reset" => Command::Camera(Move::Reset),
        "measure" => Command::Do(Action::Measure(match rest {
            [] => None,
            ["interactive"] => Some(Preset::Interactive.goal()),
            ["balanced"] => Some(Preset::Balanced.goal()),
            ["reference"] => Some(Preset::Reference.goal()),
            ["error", number] => Some(Goal::MaxError(above_zero(verb, number)?)),
            ["budget", number] => Some(Goal::Budget(above_zero(verb, number)?)),
            _ => return Err("write measure, followed by nothing, a preset, error DE or budget MS".to_owned()),
        })),
        "palette" => match rest {
            ["on" | "off"] => Command::Do(Action::Palette(switch(verb, rest)?)),
            ["offer"] => Command::Do(Action::Offer),
            _ => edit(Edit::Design(design(rest)?)),
        },
        "spectrum" => {
            const USE: &str = "spectrum material NAME = STANDARD, or spectrum light NAME = STANDARD";
            let (side, rest) = match rest {
                ["material", rest @ ..] => (Side::Material, rest),
                ["light", rest @ ..] => (Side::Light, rest),
                _ => return Err(USE.to_owned()),
            };
            let text = rest.join(" ");
            let (name, standard) = text.split_once('=').ok_or(USE)?;
            Command::Spectrum(side, name.trim().to_owned(), standard.trim().to_owned())
        }
        "solve" => Command::Do(Action::Solve(None)),
        "cancel" if rest == ["refining"] => Command::Do(Action::StopRefining),
        "cancel" if rest == ["page"] => Command::Do(Action::GiveUpPage),
        "cancel" => Command::Do(Action::GiveUp),
        "undo" => Command::Do(Action::Undo),
        "redo" => Command::Do(Action::Redo),
        "restart" => Command::Do(Action::Restart),
        "open" => Command::Do(Action::Open(Box::new(Source::of(&file()?)))),
        "window" => Command::Do(Action::SaveWindow(file()?)),
        "picture" => Command::Do(Action::SavePicture(Some(file()?))),
        "accumulators" => Command::Do(Action::SaveAccumulators(Some(file()?))),
        "page" => Command::Do(Action::SavePage(Some(file()?))),
        "save" => match rest {
            ["session", file @ ..] if !file.is_empty() => Command::Do(Action::SaveSession(Some(file.join(" ").into()))),
            _ => return Err("save session FILE".to_owned()),
        },
        "panels" => Command::Do(Action::Panels(switch(verb, rest)?)),
        "dock" => {
            const USE: &str = "dock SIDE on, or dock SIDE off; SIDE is left, right or bottom";
            let (side, rest) = rest.split_first().ok_or(USE)?;
            let dock = Dock::ALL.into_iter().find(|dock| dock.name() == *side).ok_or(USE)?;
            Command::Do(Action::Arrange(Arrange::Dock(dock, switch(verb, rest)?)))
        }
        "help" => Command::Do(Action::Arrange(Arrange::Help(switch(verb, rest)?))),
        "lesson" => {
            // People count from 1.
            let step = numbers::<usize, 1>(verb, rest)?[0];
            Command::Do(Action::Arrange(Arrange::Lesson(step.checked_sub(1))))
        }
        "note" => {
            const USE: &str = "note NAME on, or note NAME off; NAME is scale, letters, legend or title";
            let (name, rest) = rest.split_first().ok_or(USE)?;
            let named = |note: &Note| note.name().to_lowercase().split(' ').next() == Some(*name);
            let note = Note::ALL.into_iter().find(named).ok_or(USE)?;
            Command::Do(Action::Arrange(Arrange::Note(note, switch(verb, rest)?)))
        }
        "ruler" => match rest {
            ["on" | "off"] => Command::Do(Action::Arrange(Arrange::Ruler(switch(verb, rest)?))),
            ["at", place @ ..] => Command::Ruler(DVec2::from(numbers("ruler at", place)?)),
            ["world", end @ ..] => {
                Command::Do(Action::Arrange(Arrange::RulerEnd(DVec3::from_array(numbers("ruler world", end)?))))
            }
            _ => return Err("ruler on, off, at X Y, or world X Y Z".to_owned()),
        },
        "slices" => Command::Do(Action::Arrange(match rest {
            ["on" | "off"] => Arrange::Slices(switch(verb, rest)?),
            ["at", index @ ..] => Arrange::SliceAt(DVec3::from_array(numbers("slices at", index)?)),
            ["window", ends @ ..] => {
                let [low, high]: [f64; 2] = numbers("slices window", ends)?;
                let window = Some([low, high]).filter(|_| low < high && low.is_finite() && high.is_finite());
                Arrange::Window(window.ok_or_else(|| format!("slices window {low} {high} does not ascend"))?)
            }
            ["zoom", numbers_of_it @ ..] => {
                let [factor, x, y, z]: [f64; 4] = numbers("slices zoom", numbers_of_it)?;
                Arrange::SliceZoom(factor, DVec3::new(x, y, z))
            }
            ["materials", rest @ ..] => Arrange::SliceMaterials(switch("slices materials", rest)?),
            ["labels", rest @ ..] => Arrange::SliceLabels(switch("slices labels", rest)?),
            _ => {
                let uses = "slices on, off, at X Y Z, zoom FACTOR X Y Z, window LOW HIGH, materials on, materials off, \
                            labels on, labels off";
                return Err(uses.to_owned());
            }
        })),
        "tab" => {
            let tabs: Vec<_> = Tab::RIGHT.into_iter().chain(Tab::BOTTOM).collect();
            let names: Vec<_> = tabs.iter().map(|tab| tab.name().to_lowercase()).collect();
            let found = names.iter().position(|name| *name == text());
            let at = found.ok_or_else(|| format!("{verb} NAME, one of: {}", names.join(", ")))?;
            Command::Do(Action::Arrange(Arrange::Tab(tabs[at])))
        }
        "probe" => Command::Probe(DVec2::from(numbers(verb, rest)?)),
        "size" => Command::Size(numbers(verb, rest)?),
        "pointer" => {
            let [x, y] = numbers(verb, rest)?;
            Command::Input(Input::Pointer(x, y))
        }
        "press" | "release" => Command::Input(Input::Button(verb == "press")),
        "scroll" => Command::Input(Input::Scroll(numbers::<f32, 1>(verb, rest)?[0])),
        "key" => Command::Input(Input::Key(name()?)),
        "drop" => Command::Input(Input::Drop(file()?)),
        _ => return Err(format!("{verb:?} is not a script command")),
    })
}

fn numbers<T: FromStr, const N: usize>(verb: &str, words: &[&str]) -> Result<[T; N], String> {
    let numbers: Option<Vec<T>> = words.iter().map(|word| word.parse().ok()).collect();
    let wanted = if N == 1 { "a number".to_owned() } else { format!("{N} numbers") };
    numbers.and_then(|numbers| numbers.try_into().ok()).ok_or_else(|| format!("{verb} needs {wanted}"))
}

/// Parses the arguments of `palette`.
fn design(words: &[&str]) -> Result<Step, String> {
    const USE: &str = "palette on, off, offer, target ROW COLUMN COLOUR, weight ROW COLUMN NUMBER, open SIDE INDEX, \
                       given SIDE INDEX, bounds SIDE INDEX LOW HIGH or smooth NUMBER; SIDE is material or light";
    let side = |word: &str| match word {
        "material" => Ok(Side::Material),
        "light" => Ok(Side::Light),
        _ => Err(USE.to_owned()),
    };
    let index = |word: &&str| word.parse::<usize>().map_err(|_| USE.to_owned());
    Ok(match words {
        ["target", row, column, colour @ ..] => {
            let target = match colour {
                ["free"] => None,
                ["black"] => Some(Target::Black),
                ["as", row, column] => Some(Target::Like { material: index(row)?, light: index(column)? }),
                [code] => Some(Target::Srgb(srgb_code(code).map_err(|error| error.to_string())?)),
                _ => return Err(USE.to_owned()),
            };
            Step::Target(index(row)?, index(column)?, target)
        }
        ["weight", row, column, number] => {
            Step::Weight(index(row)?, index(column)?, numbers::<f64, 1>("palette weight", &[number])?[0])
        }
        [how @ ("open" | "given"), of, at] => Step::Open(side(of)?, index(at)?, *how == "open"),
        ["smooth", number] => Step::SmoothAll(numbers::<f64, 1>("palette smooth", &[number])?[0]),
        ["bounds", of, at, low, high] => Step::Bounds(side(of)?, index(at)?, numbers("palette bounds", &[low, high])?),
        _ => return Err(USE.to_owned()),
    })
}

fn above_zero(verb: &str, word: &str) -> Result<f64, String> {
    let number = word.parse().ok().filter(|&number: &f64| number > 0.0 && number.is_finite());
    number.ok_or_else(|| format!("{verb} needs a number above 0, not {word:?}"))
}

/// Points of a factor by the gradient, as magnitudes and factors in turn.
fn factor_points(verb: &str, words: &[&str]) -> Result<Vec<(f64, f64)>, String> {
    if words.is_empty() || !words.len().is_multiple_of(2) {
        return Err("write off, or MAGNITUDE FACTOR once or more".to_owned());
    }
    let point = |pair: &[&str]| numbers(verb, pair).map(|[magnitude, factor]: [f64; 2]| (magnitude, factor));
    words.chunks_exact(2).map(point).collect()
}

fn switch(verb: &str, words: &[&str]) -> Result<bool, String> {
    match words {
        ["on"] => Ok(true),
        ["off"] => Ok(false),
        _ => Err(format!("{verb} needs on or off")),
    }
}

impl About {
    /// Returns the edit of the object `name` in `state`.
    ///
    /// # Errors
    ///
    /// A message that lists the existing names.
    pub fn edit(self, state: &State, name: &str) -> Result<Edit, String> {
        let find = |names: Vec<&str>| {
            let found = names.iter().position(|&one| one == name);
            found.ok_or_else(|| format!("unknown name {name:?}; the names are {}", names.join(", ")))
        };
        let light = || find(state.scene.lights.iter().map(|light| light.name.as_str()).collect());
        let node = || find(state.dial.nodes.iter().map(|node| node.light.as_str()).collect());
        let preset = || find(state.dial.presets.iter().map(|one| one.name.as_str()).collect());
        let material = || find(state.scene.materials.iter().map(|material| material.name.as_str()).collect());
        let field = || find(state.scene.fields.iter().map(|field| field.name.as_str()).collect());
        let labels = || state.scene.labels.iter().flat_map(|labels| &labels.declared);
        let label = || find(labels().map(|entry| entry.name.as_str()).collect());
        Ok(match self {
            Self::Weight(weight) => Edit::Weight(light()?, weight),
            Self::On(on) => Edit::On(light()?, on),
            Self::Solo => Edit::Solo(Some(light()?)),
            Self::HandOnNode => Edit::HandOnNode(node()?),
            Self::NodePlace(place) => Edit::NodePlace(node()?, place),
            Self::NodeOn(on) => Edit::NodeOn(node()?, on),
            Self::DialPreset => Edit::DialPreset(preset()?),
            Self::Rename(new) => Edit::Rename(preset()?, new),
            Self::Forget => Edit::Forget(preset()?),
            Self::AddInterval([from, to, ramp, opacity]) => {
                let interval = Interval { material: material()?, range: [from, to], ramp, opacity, absorption: 0.0 };
                Edit::AddInterval(interval, Vec::new())
            }
            Self::IntervalMaterial(index) => {
                Edit::Interval(index, Interval { material: material()?, ..interval(state, index)? })
            }
            Self::Occludes(part) => Edit::Occludes(material()?, part),
            Self::Hidden(hides) => Edit::Hidden(field()?, hides),
            Self::LabelOpacity(opacity) => {
                let index = label()?;
                if labels().nth(index).is_some_and(|entry| !entry.terms.is_empty()) {
                    return Err(format!("label {name:?} goes by value: its transfer function is in the scene file"));
                }
                Edit::Label(index, labels().nth(index).map_or(0, |entry| entry.material), opacity)
            }
        })
    }
}

/// Returns the interval that is term `index` of the transfer function.
///
/// # Errors
///
/// A message with the number of terms.
pub fn interval(state: &State, index: usize) -> Result<Interval, String> {
    let terms = &state.scene.transfer.terms;
    let found = terms.get(index).and_then(|term| term.as_interval());
    found.ok_or_else(|| format!("no interval {index} among the {} terms of the transfer function (counted from 0; curves are not intervals)", terms.len()))
}
