//! Cost of results and their distance from the truth.

mod bench;
mod cache;
mod choice;
mod clock;
mod consistency;
mod difference;
mod enlarge;
pub mod extremes;
mod findings;
mod goals;
mod image_error;
mod ladder;
mod model;
mod needs;
mod report;
mod rungs;
mod sample;
mod setting;
mod skipping;
mod survey;
mod sweep;
mod table;
mod written;

pub use choice::{Choice, ChoiceError, Goal, Pixels, Point, Preset, Tried, Wanted, choose, curve};
pub use clock::{Stopwatch, Summary, Timing, peak_mb, summary};
pub use consistency::{HalvedStep, RelitRow, halved_steps, relit_against_rendered};
pub use difference::Difference;
pub use enlarge::Enlargement;
pub use findings::{NodesBesideRgb, cheapest, main_cause, mark_pareto};
pub use goals::{GoalCost, GoalRow, GoalScene, GoalSummary, Ratios, goal_row};
pub use image_error::{ImageError, MeasureError, Spread};
pub use ladder::{Cause, LadderError, Lattice};
pub use model::{
    AutomaticRow, AutomaticSummary, LIGHT_GROUPS, ModelRow, ModelSetting, ModelTableError, SpectraKind,
    automatic_dimension, model_row,
};
pub use needs::{FrameCounts, NeedError, NeedRow, need_rows};
pub use report::{CostCurve, CostTable, Findings, costs_html, html, trade};
pub use rungs::{RungError, Rungs};
pub use sample::{Checked, check};
pub use setting::{Knob, Setting, Value};
pub use survey::{CloseUp, Cost, Measured, Survey, SurveyError, SurveyOptions, Times};
pub use sweep::{SweepError, settings};
pub use table::{to_csv, to_markdown, to_text};
