//! Compilation of WGSL to SPIR-V, and to plain WGSL for browsers.
//!
//! A shader's text has several parts (a common part and the stage itself); its constants come from Rust. WGSL allows a
//! use before the declaration, so the generated constants *follow* the text, and an `enable` line stays first.

mod iterations;

use std::{error::Error as _, fmt::Write as _, ops::Range};

use codespan_reporting::{
    diagnostic::{Diagnostic, Label},
    files::SimpleFiles,
    term,
};
use naga::{
    AddressSpace, ArraySize, Block, Expression, Handle, ImageClass, Literal, Module, ResourceBinding, ShaderStage,
    Span, Statement, TypeInner,
    back::{spv, wgsl},
    proc::Layouter,
    valid::{Capabilities, ModuleInfo, ValidationFlags, Validator},
};

pub use iterations::Iterations;
use iterations::iterations;

/// Entry point of every compute shader.
pub const ENTRY_POINT: &str = "main";

/// Name of the generated constants in error messages.
const CONSTANTS_NAME: &str = "generated constants";

/// Error of shader compilation.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ShaderError {
    /// The text is not valid WGSL. `excerpt` shows the location, with the file's own line numbers.
    #[error("{excerpt}")]
    Source {
        /// naga's message with the lines concerned.
        excerpt: String,
    },
    /// A constant has no WGSL literal.
    #[error("constant {name} is {value}; a WGSL constant must be finite")]
    Constant {
        /// Name of the constant.
        name: String,
        /// Value of the constant.
        value: f32,
    },
    /// The module is valid, but SPIR-V cannot express it (an entry point of another name, an `override`).
    #[error("cannot write shader {name:?} as SPIR-V")]
    Write {
        /// Name of the last part.
        name: String,
        /// naga's error.
        source: spv::Error,
    },
    /// The module is valid, but naga cannot write it as WGSL.
    #[error("cannot write shader {name:?} as WGSL")]
    WriteWgsl {
        /// Name of the last part.
        name: String,
        /// naga's error.
        source: wgsl::Error,
    },
    /// The struct does not exist.
    #[error("shader {shader:?} has no struct {name:?}")]
    NoStruct {
        /// Name of the last part.
        shader: String,
        /// Name of the struct.
        name: String,
    },
    /// A struct contains a type without a fixed size (a handle or a runtime-sized array).
    #[error("struct {name:?} of shader {shader:?} has no fixed layout")]
    NoLayout {
        /// Name of the last part.
        shader: String,
        /// Name of the struct.
        name: String,
    },
}

impl ShaderError {
    /// Name for programs; it does not change between versions.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::Source { .. } => "shader-invalid",
            Self::Constant { .. } => "shader-constant-not-finite",
            Self::Write { .. } | Self::WriteWgsl { .. } => "shader-not-writable",
            Self::NoStruct { .. } => "shader-struct-missing",
            Self::NoLayout { .. } => "shader-struct-without-layout",
        }
    }
}

/// Constants of a shader, defined once in Rust: one `const NAME: TYPE = VALUE;` each.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Constants {
    text: String,
    not_finite: Option<(String, f32)>,
}

impl Constants {
    /// Creates an empty list.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a count, a size or an index.
    #[must_use]
    pub fn u32(self, name: &str, value: u32) -> Self {
        self.line(name, "u32", format_args!("{value}u"))
    }

    /// Adds a number in the shortest decimal form that reads back as `value`. A non-finite value makes [`compile`]
    /// fail.
    #[must_use]
    pub fn f32(mut self, name: &str, value: f32) -> Self {
        if !value.is_finite() {
            self.not_finite.get_or_insert_with(|| (name.to_owned(), value));
            return self;
        }
        self.line(name, "f32", format_args!("{value:?}f"))
    }

    /// Adds a switch.
    #[must_use]
    pub fn bool(self, name: &str, value: bool) -> Self {
        self.line(name, "bool", format_args!("{value}"))
    }

    /// Adds a type alias.
    #[must_use]
    pub fn alias(mut self, name: &str, of_type: &str) -> Self {
        writeln!(self.text, "alias {name} = {of_type};").ok();
        self
    }

    fn line(mut self, name: &str, of_type: &str, value: std::fmt::Arguments<'_>) -> Self {
        // Writing to a String cannot fail.
        writeln!(self.text, "const {name}: {of_type} = {value};").ok();
        self
    }
}

/// Kind of a shader binding.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum BindingKind {
    /// `var<storage>`
    Storage,
    /// `var<uniform>`
    Uniform,
    /// `texture_3d`
    Texture,
    /// `sampler`
    Sampler,
    /// `texture_storage_2d_array`
    StorageImage,
}

/// A compute shader as the text of a browser: one part, without branches that its constants disable.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BrowserShader {
    /// WGSL.
    pub text: String,
    /// Names and kinds of the resources in use; the i-th is at binding i of group 0.
    pub resources: Vec<(String, BindingKind)>,
}

/// A compiled compute shader. Only [`compile`] makes one, so naga has validated it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shader {
    words: Vec<u32>,
    resources: Vec<String>,
    bindings: Vec<BindingKind>,
    push_constant_bytes: u32,
    iterations: Iterations,
}

impl Shader {
    /// SPIR-V 1.5.
    #[must_use]
    pub fn words(&self) -> &[u32] {
        &self.words
    }

    /// Names of the resources in use; the i-th is at binding i of group 0.
    #[must_use]
    pub fn resources(&self) -> &[String] {
        &self.resources
    }

    /// Kinds of the [`resources`](Self::resources).
    #[must_use]
    pub fn bindings(&self) -> &[BindingKind] {
        &self.bindings
    }

    /// Size of its `var<immediate>`, a multiple of 4; 0 without one.
    #[must_use]
    pub fn push_constant_bytes(&self) -> u32 {
        self.push_constant_bytes
    }

    /// Iterations of its loops.
    #[must_use]
    pub fn iterations(&self) -> Iterations {
        self.iterations
    }

    /// Number of instructions in its functions, without regard to loop counts.
    #[must_use]
    pub fn instructions(&self) -> usize {
        /// Header words of a module, and the opcodes at the start and the end of a function (SPIR-V 1.5, 2.3 and
        /// 3.42.9).
        const HEAD: usize = 5;
        const FUNCTION: u32 = 54;
        const FUNCTION_END: u32 = 56;
        let (mut at, mut within, mut count) = (HEAD, false, 0);
        while let Some(&word) = self.words.get(at) {
            let (length, code) = (word >> 16, word & 0xffff);
            within |= code == FUNCTION;
            count += usize::from(within);
            within &= code != FUNCTION_END;
            at += usize::try_from(length).unwrap_or(usize::MAX).max(1);
        }
        count
    }
}

/// Compiles the compute shader of `parts` (name for messages, text) and `constants`.
///
/// The entry point is [`ENTRY_POINT`]. Equal input gives equal words. Branches with constant conditions are resolved
/// first, so code that `constants` disable is neither compiled nor bound.
///
/// # Errors
///
/// [`ShaderError::Source`] with an excerpt for text that does not parse or is not valid, [`ShaderError::Constant`] for
/// a non-finite constant, [`ShaderError::Write`] if there is no entry point of that name.
pub fn compile(parts: &[(&str, &str)], constants: &Constants) -> Result<Shader, ShaderError> {
    let text = Text::new(parts, constants)?;
    let Resolved { module, info, resources } = text.resolved()?;
    let (resources, bindings) = resources.into_iter().unzip();
    let options = spv::Options {
        lang_version: (1, 5),
        flags: spv::WriterFlags::empty(),
        // Every loop has a bound in its WGSL, and a counter per loop costs registers.
        force_loop_bounding: false,
        ..spv::Options::default()
    };
    let entry = spv::PipelineOptions { shader_stage: ShaderStage::Compute, entry_point: ENTRY_POINT.to_owned() };
    let words = spv::write_vec(&module, &info, &options, Some(&entry))
        .map_err(|source| ShaderError::Write { name: text.name(), source })?;
    let iterations = iterations(&module);
    Ok(Shader { words, resources, bindings, push_constant_bytes: push_constant_bytes(&module), iterations })
}

/// Writes the compute shader of `parts` and `constants`, those of [`compile`], as WGSL for a browser.
///
/// # Errors
///
/// As [`compile`] for text that does not parse or is not valid; [`ShaderError::WriteWgsl`].
pub fn for_browser(parts: &[(&str, &str)], constants: &Constants) -> Result<BrowserShader, ShaderError> {
    let text = Text::new(parts, constants)?;
    let Resolved { module, info, resources } = text.resolved()?;
    let written = wgsl::write_string(&module, &info, wgsl::WriterFlags::empty())
        .map_err(|source| ShaderError::WriteWgsl { name: text.name(), source })?;
    Ok(BrowserShader { text: written, resources })
}

/// A valid module without branches that its constants disable, and its numbered resources.
struct Resolved {
    module: Module,
    info: ModuleInfo,
    resources: Vec<(String, BindingKind)>,
}

/// Replaces each `if` with a constant condition by the branch that is taken.
fn resolve_branches(module: &mut Module) {
    let Module { functions, entry_points, constants, global_expressions, .. } = module;
    let literal = |expression: &Expression| match expression {
        Expression::Literal(Literal::Bool(value)) => Some(*value),
        _ => None,
    };
    let functions = functions.iter_mut().map(|(_, function)| function);
    for function in functions.chain(entry_points.iter_mut().map(|entry| &mut entry.function)) {
        let expressions = &function.expressions;
        let known = |condition: Handle<Expression>| match &expressions[condition] {
            Expression::Constant(constant) => literal(&global_expressions[constants[*constant].init]),
            expression => literal(expression),
        };
        resolve_block(&mut function.body, &known);
        // Names of expressions in removed branches would keep them alive.
        let mut emitted = std::collections::HashSet::new();
        collect_emitted(&function.body, &mut emitted);
        function
            .named_expressions
            .retain(|expression, _| emitted.contains(expression) || !needs_emit(&function.expressions[*expression]));
    }
}

fn resolve_block(block: &mut Block, known: &impl Fn(Handle<Expression>) -> Option<bool>) {
    let mut resolved = Block::with_capacity(block.len());
    for (mut statement, span) in std::mem::take(block).span_into_iter() {
        // Statements behind the end of a block that is taken are never reached.
        if resolved.last().is_some_and(|last| {
            matches!(last, Statement::Return { .. } | Statement::Break | Statement::Continue | Statement::Kill)
        }) {
            break;
        }
        match &mut statement {
            Statement::If { condition, accept, reject } => {
                resolve_block(accept, known);
                resolve_block(reject, known);
                if let Some(value) = known(*condition) {
                    let mut taken = std::mem::take(if value { accept } else { reject });
                    resolved.append(&mut taken);
                    continue;
                }
            }
            Statement::Block(inner) => resolve_block(inner, known),
            Statement::Loop { body, continuing, .. } => {
                resolve_block(body, known);
                resolve_block(continuing, known);
            }
            Statement::Switch { cases, .. } => cases.iter_mut().for_each(|case| resolve_block(&mut case.body, known)),
            _ => {}
        }
        resolved.push(statement, span);
    }
    *block = resolved;
}

/// Collects the expressions that the statements of `block` emit.
fn collect_emitted(block: &Block, emitted: &mut std::collections::HashSet<Handle<Expression>>) {
    for statement in block {
        match statement {
            Statement::Emit(range) => emitted.extend(range.clone()),
            Statement::If { accept, reject, .. } => {
                collect_emitted(accept, emitted);
                collect_emitted(reject, emitted);
            }
            Statement::Block(inner) => collect_emitted(inner, emitted),
            Statement::Loop { body, continuing, .. } => {
                collect_emitted(body, emitted);
                collect_emitted(continuing, emitted);
            }
            Statement::Switch { cases, .. } => cases.iter().for_each(|case| collect_emitted(&case.body, emitted)),
            Statement::Call { result: Some(result), .. } => {
                emitted.insert(*result);
            }
            _ => {}
        }
    }
}

/// Whether an expression needs an emit statement.
fn needs_emit(expression: &Expression) -> bool {
    !expression.needs_pre_emit()
}

/// Numbers the module's resources 0, 1, … in the order of their bindings, and returns their names and kinds in that
/// order.
fn number_resources(module: &mut Module) -> Vec<(String, BindingKind)> {
    let mut bound: Vec<_> = module
        .global_variables
        .iter()
        .filter_map(|(handle, variable)| variable.binding.map(|binding| (binding.group, binding.binding, handle)))
        .collect();
    bound.sort_by_key(|&(group, binding, _)| (group, binding));
    let mut resources = Vec::new();
    for (number, (_, _, handle)) in (0..).zip(bound) {
        let variable = module.global_variables.get_mut(handle);
        variable.binding = Some(ResourceBinding { group: 0, binding: number });
        let kind = match (variable.space, &module.types[variable.ty].inner) {
            (AddressSpace::Uniform, _) => BindingKind::Uniform,
            (_, TypeInner::Sampler { .. }) => BindingKind::Sampler,
            (_, TypeInner::Image { class: ImageClass::Storage { .. }, .. }) => BindingKind::StorageImage,
            (_, TypeInner::Image { .. }) => BindingKind::Texture,
            _ => BindingKind::Storage,
        };
        resources.push((variable.name.clone().unwrap_or_default(), kind));
    }
    resources
}

/// Size of the module's `var<immediate>`; 0 without one.
fn push_constant_bytes(module: &Module) -> u32 {
    let mut immediates =
        module.global_variables.iter().filter(|(_, variable)| variable.space == AddressSpace::Immediate);
    immediates.next().map_or(0, |(_, variable)| module.types[variable.ty].inner.size(module.to_ctx()))
}

/// Layout of a struct field.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FieldLayout {
    /// Name.
    pub name: String,
    /// Offset in bytes.
    pub offset: u32,
    /// Size in bytes, without trailing padding.
    pub size: u32,
}

/// Layout of a struct in a shader.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StructLayout {
    /// Fields in order.
    pub fields: Vec<FieldLayout>,
    /// Size in bytes, with trailing padding.
    pub size: u32,
}

/// Returns the layout of a shader's struct `name`, for tests that compare it with the host's copy.
///
/// `parts` and `constants` are those of [`compile`].
///
/// # Errors
///
/// As [`compile`] for text that does not parse; [`ShaderError::NoStruct`], [`ShaderError::NoLayout`].
pub fn struct_layout(parts: &[(&str, &str)], constants: &Constants, name: &str) -> Result<StructLayout, ShaderError> {
    let text = Text::new(parts, constants)?;
    let module = text.parse()?;
    let no_layout = || ShaderError::NoLayout { shader: text.name(), name: name.to_owned() };
    let (members, size) = module
        .types
        .iter()
        .find_map(|(_, candidate)| match &candidate.inner {
            TypeInner::Struct { members, span } if candidate.name.as_deref() == Some(name) => Some((members, *span)),
            _ => None,
        })
        .ok_or_else(|| ShaderError::NoStruct { shader: text.name(), name: name.to_owned() })?;
    let mut layouter = Layouter::default();
    layouter.update(module.to_ctx()).map_err(|_| no_layout())?;
    let fields = members
        .iter()
        .map(|member| {
            if matches!(module.types[member.ty].inner, TypeInner::Array { size: ArraySize::Dynamic, .. }) {
                return Err(no_layout());
            }
            let size = layouter[member.ty].size;
            Ok(FieldLayout { name: member.name.clone().unwrap_or_default(), offset: member.offset, size })
        })
        .collect::<Result<_, _>>()?;
    Ok(StructLayout { fields, size })
}

/// The parts of a shader joined to one text, with the range of each part for error messages.
struct Text<'a> {
    whole: String,
    /// Name, text and range in `whole` of each part; the constants are the last.
    parts: Vec<(&'a str, &'a str, Range<usize>)>,
}

impl<'a> Text<'a> {
    fn new(parts: &[(&'a str, &'a str)], constants: &'a Constants) -> Result<Self, ShaderError> {
        if let Some((name, value)) = &constants.not_finite {
            return Err(ShaderError::Constant { name: name.clone(), value: *value });
        }
        let mut text = Self { whole: String::new(), parts: Vec::new() };
        for &(name, part) in parts.iter().chain([&(CONSTANTS_NAME, constants.text.as_str())]) {
            let start = text.whole.len();
            text.whole.push_str(part);
            text.parts.push((name, part, start..text.whole.len()));
            text.whole.push('\n');
        }
        Ok(text)
    }

    /// Name of the last part before the constants.
    fn name(&self) -> String {
        self.parts.iter().rev().nth(1).map_or("", |(name, ..)| name).to_owned()
    }

    fn parse(&self) -> Result<Module, ShaderError> {
        naga::front::wgsl::parse_str(&self.whole).map_err(|error| {
            let notes = error.notes().map(|note| format!("note: {note}")).collect();
            self.error(error.message(), error.labels(), notes)
        })
    }

    fn resolved(&self) -> Result<Resolved, ShaderError> {
        let mut module = self.parse()?;
        self.validate(&module)?;
        resolve_branches(&mut module);
        naga::compact::compact(&mut module, naga::compact::KeepUnused::No);
        let resources = number_resources(&mut module);
        let info = self.validate(&module)?;
        Ok(Resolved { module, info, resources })
    }

    fn validate(&self, module: &Module) -> Result<ModuleInfo, ShaderError> {
        Validator::new(ValidationFlags::all(), Capabilities::IMMEDIATES).validate(module).map_err(|error| {
            let labels = error.spans().map(|(span, label)| (*span, label.as_str()));
            let mut notes = Vec::new();
            let mut cause = error.as_inner().source();
            while let Some(next) = cause {
                notes.push(next.to_string());
                cause = next.source();
            }
            self.error(&error.as_inner().to_string(), labels, notes)
        })
    }

    /// Returns the error `message` with the source lines of `labels`.
    fn error<'l>(
        &self,
        message: &str,
        labels: impl Iterator<Item = (Span, &'l str)>,
        notes: Vec<String>,
    ) -> ShaderError {
        let mut files = SimpleFiles::new();
        for (name, part, _) in &self.parts {
            files.add(*name, *part);
        }
        let labels = labels
            .filter_map(|(span, label)| {
                let span = span.to_range()?;
                // An error at the end of the text has an offset one past the last part.
                let last = self.parts.len() - 1;
                let part = self.parts.iter().position(|(.., place)| span.start <= place.end).unwrap_or(last);
                let place = &self.parts[part].2;
                let within = span.start.min(place.end) - place.start..span.end.min(place.end) - place.start;
                Some(Label::primary(part, within).with_message(label))
            })
            .collect();
        let diagnostic = Diagnostic::error().with_message(message).with_labels(labels).with_notes(notes);
        let excerpt = term::emit_into_string(&term::Config::default(), &files, &diagnostic)
            .unwrap_or_else(|_| message.to_owned());
        ShaderError::Source { excerpt: excerpt.trim_end().to_owned() }
    }
}
