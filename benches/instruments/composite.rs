//! Time to composite the films of several processes, which this program starts by `mpirun`.

use std::error::Error;
use std::process::Command;

use serde::{Deserialize, Serialize};

use relume::film::Film;
use relume::measure::Stopwatch;
use relume::ranks::{Mpi, Ranks, all_gather, over};

/// Numbers of processes.
const PROCESSES: [usize; 3] = [1, 2, 4];
/// Width and height of the picture.
const SIZE: [usize; 2] = [800, 800];
/// Eight components at two positions, and as many of transmittance: 61.4 MB.
const COMPONENTS: usize = 8;
/// Timed composites, of which the shortest counts: other programs delay the rest.
const RUNS: usize = 7;
/// Largest time of four processes on two cores, in s.
const LIMIT: f64 = 0.1;
/// Set in the processes that `mpirun` starts.
const STARTED: &str = "RELUME_COMPOSITE";

/// A number of processes, each with the film of a block.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct CompositeRow {
    pub(crate) processes: usize,
    /// Bytes of the film of a block.
    pub(crate) film_bytes: usize,
    /// Bytes that a process sends.
    pub(crate) sent_bytes: usize,
    /// Shortest and median time until the last process has composited its rows, in s.
    pub(crate) seconds: [f64; 2],
    /// Least CPU time of all processes together, in s.
    pub(crate) cpu_seconds: f64,
}

impl CompositeRow {
    /// True unless four processes miss the limit.
    pub(crate) fn holds(&self) -> bool {
        self.processes < 4 || self.seconds[0] <= LIMIT
    }
}

/// Measures each number of processes; in one of these, takes part and ends it.
pub(crate) fn composite_rows() -> Result<Vec<CompositeRow>, Box<dyn Error>> {
    if std::env::var_os(STARTED).is_some() {
        let mpi = Mpi::start().ok_or("MPI was started twice")?;
        let row = measured(&mpi)?;
        if mpi.rank() == 0 {
            println!("{}", serde_json::to_string(&row)?);
        }
        drop(mpi);
        std::process::exit(0);
    }
    let of = |processes: usize| -> Result<CompositeRow, Box<dyn Error>> {
        let mut command = Command::new("mpirun");
        command.args(["--allow-run-as-root", "--oversubscribe", "-n", &processes.to_string()]);
        command.arg(std::env::current_exe()?).arg("composite").env(STARTED, "1");
        let output = command.output()?;
        if !output.status.success() {
            return Err(format!("{processes} processes: {}", String::from_utf8_lossy(&output.stderr)).into());
        }
        Ok(serde_json::from_slice(&output.stdout)?)
    };
    PROCESSES.into_iter().map(of).collect()
}

/// Composites a block a process, which cover the whole picture: none is sparse.
fn measured(ranks: &dyn Ranks) -> Result<CompositeRow, Box<dyn Error>> {
    let pixels = SIZE[0] * SIZE[1];
    let film = Film {
        size: SIZE,
        components: COMPONENTS,
        accumulators: vec![0.25_f32; 2 * COMPONENTS * pixels],
        transmittance: vec![0.5_f32; COMPONENTS * pixels],
    };
    let film_bytes = 4 * (film.accumulators.len() + film.transmittance.len());
    let low_first = vec![true; ranks.count() - 1];
    let (mut all, mut sent_bytes, mut cpu_seconds) = (Vec::new(), 0, f64::INFINITY);
    for _ in 0..RUNS {
        let mut own = Some(film.clone());
        all_gather(ranks, Vec::new());
        let watch = Stopwatch::start();
        let share = over(ranks, ranks.count(), &low_first, &mut |_| own.take().ok_or("a process has one block"))?;
        let took = watch.read();
        sent_bytes = share.ok_or("films of one shape composite")?.sent_bytes;
        let told = all_gather(ranks, serde_json::to_vec(&[took.wall_ms, took.cpu_ms])?);
        let told = told.iter().map(|json| serde_json::from_slice(json)).collect::<Result<Vec<[f64; 2]>, _>>()?;
        all.push(told.iter().map(|[wall, _]| wall / 1e3).fold(0.0, f64::max));
        cpu_seconds = cpu_seconds.min(told.iter().map(|[_, cpu]| cpu / 1e3).sum());
    }
    all.sort_by(f64::total_cmp);
    Ok(CompositeRow { processes: ranks.count(), film_bytes, sent_bytes, seconds: [all[0], all[RUNS / 2]], cpu_seconds })
}

/// The rows as a table.
pub(crate) fn text(rows: &[CompositeRow]) -> String {
    let mut text = format!(
        "{}×{} pixels, every pixel of every block: processes, MB of a film, MB sent by each, ms (shortest and median of \
         {RUNS}), CPU ms of all; at most {:.0} ms of four\n",
        SIZE[0],
        SIZE[1],
        1e3 * LIMIT
    );
    for CompositeRow { processes, film_bytes, sent_bytes, seconds, cpu_seconds } in rows {
        let [film, sent] = [film_bytes, sent_bytes].map(|&bytes| relume::number::count(bytes) / 1e6);
        let [shortest, median] = seconds.map(|seconds| 1e3 * seconds);
        text += &format!("{processes}, {film:.1}, {sent:.1}, {shortest:.0}, {median:.0}, {:.0}\n", 1e3 * cpu_seconds);
    }
    text
}
