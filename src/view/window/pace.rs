//! Turns of the event loop: input, frames and slices of the march.

use std::time::{Duration, Instant};

use winit::event_loop::{ActiveEventLoop, ControlFlow};

use super::beside::NEWS_OF_MEASURING;
use super::picture::REST;
use super::{ViewError, Viewer};
use crate::render::RenderError;
use crate::view::engine::Stepped;
use crate::vulkan::VulkanError;

/// Time between two frames that only update the progress of a march.
const NEWS_OF_MARCHING: Duration = Duration::from_millis(100);
/// Interval for checking on background tasks that block the march.
const LOOKED_AFTER: Duration = Duration::from_millis(4);

/// Whose turn it is.
#[derive(Default)]
pub(super) struct Pace {
    pub(super) turn: Turn,
    /// Latest time of the next frame while the engine marches.
    pub(super) marches_until: Option<Instant>,
}

/// Last turn of the event loop: frames and march slices alternate, and input is handled before either.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Turn {
    /// Slice of a march.
    #[default]
    Marched,
    /// Frame in an earlier turn.
    Drawn,
    /// Frame in this turn.
    Drawing,
}

impl Viewer {
    /// Runs `work`, which blocks input. Reopens a lost device; any other error closes the window.
    pub(super) fn attempt(&mut self, events: &ActiveEventLoop, work: impl FnOnce(&mut Self) -> Result<(), ViewError>) {
        let (begun, shown) = (Instant::now(), self.record.report.first_picture_ms.is_some());
        let done = work(self);
        if shown {
            let took = 1000.0 * begun.elapsed().as_secs_f64();
            self.record.report.stall_ms = self.record.report.stall_ms.max(took);
        }
        let done = match done {
            Err(ViewError::Vulkan(lost @ VulkanError::DeviceLost { .. })) => self.recover(lost),
            done => done,
        };
        if let Err(error) = done {
            self.ending.failed = Some(error);
            events.exit();
        }
    }

    /// Continues the march between two frames, and requests a frame when a picture is finished or one is due.
    pub(super) fn go_on(&mut self, events: &ActiveEventLoop) -> Result<(), ViewError> {
        if self.pace.turn == Turn::Drawing {
            // Input is handled first.
            self.pace.turn = Turn::Drawn;
            return Ok(());
        }
        let rests = self.hand_rests();
        let mut stepped = Stepped::default();
        if let (Some(screen), Some(engine)) = (&mut self.screen, &mut self.engine)
            && engine.has_work(rests)
        {
            screen.surface.wait()?;
            let begun = Instant::now();
            let made = engine.step(rests);
            let took = 1000.0 * begun.elapsed().as_secs_f64();
            self.record.report.longest_step_ms = self.record.report.longest_step_ms.max(took);
            stepped = self.made(made)?;
        }
        self.pace.turn = Turn::Marched;
        let Some(due) = self.pace.marches_until else { return Ok(()) };
        let now = Instant::now();
        if stepped.shown || !self.is_busy() || now >= due {
            self.pace.marches_until = None;
            events.set_control_flow(ControlFlow::Wait);
            self.redraw();
        } else if stepped.worked {
            events.set_control_flow(ControlFlow::Poll);
        } else {
            events.set_control_flow(ControlFlow::WaitUntil(due.min(now + LOOKED_AFTER)));
        }
        Ok(())
    }

    /// Whether there is something to march at present.
    pub(super) fn is_busy(&self) -> bool {
        let rests = self.hand_rests();
        self.engine.as_ref().is_some_and(|engine| engine.has_work(rests))
    }

    /// Requests a frame: now, or after the next march slice if it is the march's turn.
    pub(super) fn redraw(&mut self) {
        if self.pace.turn != Turn::Marched && self.is_busy() {
            self.pace.marches_until = Some(Instant::now());
        } else {
            self.screen.iter().for_each(|screen| screen.window.request_redraw());
        }
    }

    /// Returns the engine's result; reports an error other than device loss and returns the default.
    pub(super) fn made<T: Default>(&mut self, made: Result<T, RenderError>) -> Result<T, VulkanError> {
        match made {
            Err(RenderError::Vulkan(lost @ VulkanError::DeviceLost { .. })) => Err(lost),
            Err(error) => {
                self.tell(&error);
                Ok(T::default())
            }
            Ok(made) => Ok(made),
        }
    }

    /// Schedules the next frame.
    pub(super) fn next(&mut self, events: &ActiveEventLoop, again: Duration, news: bool) {
        let over = self.options.frames.is_some_and(|frames| self.record.report.frames >= u64::from(frames));
        if self.ending.failed.is_some()
            || self.ending.now
            || (over && self.options.script.is_none() && self.loading.now.is_none())
        {
            events.exit();
            return;
        }
        events.set_control_flow(ControlFlow::Wait);
        let (busy, unfinished) = (self.is_busy(), self.engine.as_ref().is_some_and(|engine| engine.has_work(true)));
        // Frames would disturb the measurement, and a script waits for its end.
        let again =
            if self.tasks.measuring.is_some() { again.clamp(NEWS_OF_MEASURING / 7, NEWS_OF_MEASURING) } else { again };
        // `settle` waits for a picture, which needs no frames.
        let driven = self.is_scripted() && self.tasks.measuring.is_none() && !(busy && self.settles());
        let at_once = news || self.panels.untold || driven || self.saving.capture.is_some();
        match if at_once { Next::Frame } else { next(again, busy, unfinished) } {
            Next::Frame => self.redraw(),
            Next::March(most) => self.pace.marches_until = Some(Instant::now() + most),
            Next::Rest(most) => {
                let due = Instant::now().checked_add(most).filter(|_| most < Duration::from_secs(3600));
                due.into_iter().for_each(|due| events.set_control_flow(ControlFlow::WaitUntil(due)));
            }
        }
        if self.pace.marches_until.is_some() {
            events.set_control_flow(ControlFlow::Poll);
        }
    }
}

/// Work after a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Next {
    /// Another frame.
    Frame,
    /// The march, for this long at most.
    March(Duration),
    /// Nothing, for this long at most.
    Rest(Duration),
}

/// Chooses the work after a frame, where the panels want a frame after `again`. `busy`: the engine has work at present.
/// `unfinished`: the engine has more work once input pauses, which may already have happened during a coarse march.
fn next(again: Duration, busy: bool, unfinished: bool) -> Next {
    if again.is_zero() {
        Next::Frame
    } else if busy {
        Next::March(again.min(NEWS_OF_MARCHING))
    } else {
        Next::Rest(if unfinished { again.min(REST) } else { again })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_coarse_picture_that_took_longer_than_the_hand_moved_is_refined() {
        assert_eq!(
            next(Duration::MAX, true, true),
            Next::March(NEWS_OF_MARCHING),
            "at once: nothing else would wake it"
        );
        assert_eq!(next(Duration::MAX, false, true), Next::Rest(REST), "when the hand rests");
        assert_eq!(next(Duration::MAX, false, false), Next::Rest(Duration::MAX), "a finished picture needs no frame");
        assert_eq!(next(REST / 2, false, true), Next::Rest(REST / 2), "or when the panels want one");
        assert_eq!(next(Duration::ZERO, true, true), Next::Frame, "at once, if they want it");
    }
}
