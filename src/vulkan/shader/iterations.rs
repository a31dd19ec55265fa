//! Iterations of the loops of a shader, counted from its module.

use naga::{Block, Expression, Function, Handle, Literal, Module, Statement};

/// Numbers of iterations of an invocation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Iterations {
    /// Of loops that end after a number known to the shader, outside all others: at most so many.
    pub once: usize,
    /// Of one turn of each of the other loops, with those of the known loops in them.
    pub per_turn: usize,
}

/// Counts the iterations of `module`, of which every loop that is not a `for` to a known number is one of `per_turn`.
pub(super) fn iterations(module: &Module) -> Iterations {
    let counted = Counted { module };
    module.entry_points.iter().map(|entry| counted.function(&entry.function)).fold(Iterations::default(), greater)
}

fn greater(a: Iterations, b: Iterations) -> Iterations {
    Iterations { once: a.once.max(b.once), per_turn: a.per_turn.max(b.per_turn) }
}

struct Counted<'a> {
    module: &'a Module,
}

impl Counted<'_> {
    fn function(&self, function: &Function) -> Iterations {
        self.block(&function.body, function)
    }

    fn block(&self, block: &Block, function: &Function) -> Iterations {
        let sum = |a: Iterations, b: Iterations| Iterations {
            once: a.once.saturating_add(b.once),
            per_turn: a.per_turn.saturating_add(b.per_turn),
        };
        block.iter().map(|statement| self.statement(statement, function)).fold(Iterations::default(), sum)
    }

    fn statement(&self, statement: &Statement, function: &Function) -> Iterations {
        match statement {
            Statement::Block(inner) => self.block(inner, function),
            Statement::If { accept, reject, .. } => greater(self.block(accept, function), self.block(reject, function)),
            Statement::Switch { cases, .. } => {
                cases.iter().map(|case| self.block(&case.body, function)).fold(Iterations::default(), greater)
            }
            Statement::Call { function, .. } => self.function(&self.module.functions[*function]),
            Statement::Loop { body, continuing, .. } => {
                let [body_counts, after] = [body, continuing].map(|block| self.block(block, function));
                let turn = 1 + body_counts.once + after.once;
                let within = body_counts.per_turn + after.per_turn;
                match self.turns(body, function) {
                    Some(turns) => Iterations { once: turns.saturating_mul(turn), per_turn: turns.max(1) * within },
                    None => Iterations { once: 0, per_turn: turn.saturating_add(within) },
                }
            }
            _ => Iterations::default(),
        }
    }

    /// Largest number of turns of a `for` loop with this body, which counts from 0 or more in steps of 1 or more.
    fn turns(&self, body: &Block, function: &Function) -> Option<usize> {
        let condition = body.iter().find_map(|statement| match statement {
            Statement::If { condition, accept, reject }
                if accept.is_empty() && matches!(reject.first(), Some(Statement::Break)) =>
            {
                Some(Some(*condition))
            }
            Statement::Emit(_) => None,
            // A loop that does something first is no `for`.
            _ => Some(None),
        })??;
        let Expression::Binary { op, left, right } = function.expressions[condition] else { return None };
        let is_counter = matches!(function.expressions[left], Expression::Load { .. });
        let end = self.bound(right, function).filter(|_| is_counter)?;
        match op {
            naga::BinaryOperator::Less => Some(end),
            naga::BinaryOperator::LessEqual => Some(end + 1),
            _ => None,
        }
    }

    /// Largest value of an expression, if its text states one.
    fn bound(&self, expression: Handle<Expression>, function: &Function) -> Option<usize> {
        let bound = |expression| self.bound(expression, function);
        match function.expressions[expression] {
            Expression::Literal(literal) => whole(literal),
            Expression::Constant(constant) => {
                match self.module.global_expressions[self.module.constants[constant].init] {
                    Expression::Literal(literal) => whole(literal),
                    _ => None,
                }
            }
            Expression::Select { accept, reject, .. } => Some(bound(accept)?.max(bound(reject)?)),
            Expression::Math { fun: naga::MathFunction::Min, arg, arg1: Some(other), .. } => {
                bound(arg).into_iter().chain(bound(other)).min()
            }
            _ => None,
        }
    }
}

/// The whole number of a literal.
fn whole(literal: Literal) -> Option<usize> {
    match literal {
        Literal::U32(number) => usize::try_from(number).ok(),
        Literal::I32(number) => usize::try_from(number).ok(),
        Literal::AbstractInt(number) => usize::try_from(number).ok(),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Constants, compile};
    use super::Iterations;

    fn counted(text: &str) -> Option<Iterations> {
        let constants = Constants::new().u32("FOUR", 4).bool("OFF", false);
        compile(&[("text", text)], &constants).ok().map(|shader| shader.iterations())
    }

    #[test]
    fn loops_are_counted_where_they_are_called_and_not_where_they_are_switched_off() {
        let text = "
            @group(0) @binding(0) var<storage, read_write> out: array<u32>;
            fn lanes(first: u32) -> u32 {
                var sum = first;
                for (var lane = 0u; lane < FOUR; lane += 1u) {
                    for (var i = 1u; i <= 2u; i += 1u) { sum += i; }
                }
                return sum;
            }
            fn march(end: u32) -> u32 {
                var sum = 0u;
                for (var n = 0u; n < end; n += 1u) {
                    sum += lanes(n);
                    if (OFF) { sum += lanes(sum); }
                }
                return sum;
            }
            @compute @workgroup_size(1)
            fn main(@builtin(global_invocation_id) id: vec3u) {
                var sum = lanes(id.x);
                var n = 0u;
                loop {
                    loop {
                        n += 1u;
                        if (n > id.y) { break; }
                    }
                    sum += march(n);
                    if (n >= id.x) { break; }
                }
                let voxels = select(1u, 8u, sum > 3u);
                for (var i = 0u; i < voxels; i += 1u) { sum += i; }
                out[0] = sum;
            }";
        // lanes: 4 × (1 + 3 × 1), because `<=` ends after at most three from 0.
        let lanes = 16;
        let per_turn = 1 + 1 + (1 + lanes);
        assert_eq!(counted(text), Some(Iterations { once: lanes + 8, per_turn }));
    }

    #[test]
    fn a_shader_without_loops_has_no_iterations() {
        let text = "@compute @workgroup_size(1) fn main() {}";
        assert_eq!(counted(text), Some(Iterations::default()));
    }
}
