// The part of a light that arrives at a step, where all absorption is grey: one number. Part of `march.wgsl`.

alias Share = f32;

fn whole_share() -> Share {
    return 1.0;
}

// The numbers of a lane.
fn share_in(share: Share, lane: u32) -> vec4f {
    return vec4f(share);
}

fn scaled_share(share: Share, factor: f32) -> Share {
    return share * factor;
}

// `sum` plus a share times a shade.
fn plus_shade(sum: Share, share: Share, shade: f32) -> Share {
    return fma(share, shade, sum);
}

// This number in every component: the optical depth of all that is grey.
fn even_share(number: f32) -> Share {
    return number;
}

// The share behind an optical depth.
fn behind(depth: Share) -> Share {
    return exp(-depth);
}

// The share of light along the ray of the eye: its mean over the step.
fn share_of_ray(transmittance: Transmittance, opacity: Transmittance) -> Share {
    let left = brightest(transmittance);
    return fma(-0.5 * left, brightest(opacity), left);
}
