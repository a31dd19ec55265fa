// The part of a light that arrives at a step through coloured absorbers: a number per coefficient of the colour model. Part of
// `march.wgsl`, in place of `share_grey.wgsl`.

alias Share = array<vec4f, LANES>;

// Coefficients of each absorber.
struct Absorbers {
    coefficients: array<vec4f, ABSORBER_VECTORS>,
}

@group(0) @binding(18) var<uniform> absorbers: Absorbers;

fn whole_share() -> Share {
    return even_share(1.0);
}

// The numbers of a lane.
fn share_in(share: Share, lane: u32) -> vec4f {
    return share[lane];
}

fn scaled_share(share: Share, factor: f32) -> Share {
    var scaled: Share;
    for (var lane = 0u; lane < LANES; lane += 1u) {
        scaled[lane] = share[lane] * factor;
    }
    return scaled;
}

// `sum` plus a share times a shade.
fn plus_shade(sum: Share, share: Share, shade: f32) -> Share {
    var total: Share;
    for (var lane = 0u; lane < LANES; lane += 1u) {
        total[lane] = fma(share[lane], vec4f(shade), sum[lane]);
    }
    return total;
}

// This number in every component: the optical depth of all that is grey.
fn even_share(number: f32) -> Share {
    var all: Share;
    for (var lane = 0u; lane < LANES; lane += 1u) {
        all[lane] = vec4f(number);
    }
    return all;
}

// `depth` plus that through an absorber.
fn absorbed(depth: Share, through: f32, absorber: u32) -> Share {
    var sum: Share;
    for (var lane = 0u; lane < LANES; lane += 1u) {
        sum[lane] = fma(vec4f(through), absorbers.coefficients[absorber * LANES + lane], depth[lane]);
    }
    return sum;
}

// The share behind an optical depth.
fn behind(depth: Share) -> Share {
    var share: Share;
    for (var lane = 0u; lane < LANES; lane += 1u) {
        share[lane] = exp(-depth[lane]);
    }
    return share;
}

// The share of light along the ray of the eye: its mean over the step.
fn share_of_ray(transmittance: Transmittance, opacity: Transmittance) -> Share {
    var share: Share;
    for (var lane = 0u; lane < LANES; lane += 1u) {
        share[lane] = fma(-0.5 * transmittance[lane], opacity[lane], transmittance[lane]);
    }
    return share;
}
