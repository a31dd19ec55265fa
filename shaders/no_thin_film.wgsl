// In place of `thin_film.wgsl` in plans without thin films. Branches that call these functions are not compiled.

fn read_thin_films() {
}

fn add_thin_films(light: vec3f, ray: Ray, step: Step, reached: f32, source: ptr<function, array<vec4f, LANES>>) {
}
