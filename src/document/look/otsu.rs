//! The threshold of Otsu (1979), which cuts a histogram into two classes.

use relume_base::number::count;

/// First histogram bin of objects as opposed to their surroundings: the cut into two classes with the largest variance
/// between them (Otsu 1979).
pub(super) fn threshold(bins: &[u64]) -> usize {
    let weight = |&n: &u64| count(usize::try_from(n).unwrap_or(usize::MAX));
    otsu(&bins.iter().map(weight).collect::<Vec<_>>())
}

/// First bin of the upper of two classes with the largest variance between them (Otsu 1979).
pub(super) fn otsu(bins: &[f64]) -> usize {
    let total: f64 = bins.iter().sum();
    let moment: f64 = bins.iter().enumerate().map(|(bin, n)| count(bin) * n).sum();
    let (mut below, mut moment_below, mut best) = (0.0, 0.0, (0.0, 1));
    for (bin, n) in bins.iter().enumerate() {
        below += n;
        moment_below += count(bin) * n;
        let above = total - below;
        if below > 0.0 && above > 0.0 {
            let apart = moment_below / below - (moment - moment_below) / above;
            let between = below * above * apart * apart;
            if between > best.0 {
                best = (between, bin + 1);
            }
        }
    }
    best.1
}
