//! Notices over the picture.

use std::time::{Duration, Instant};

use egui_kittest::kittest::Queryable;
use glam::DVec3;
use relume::document::Edit;
use relume::document::moves::{Move, Side};
use relume::scene::Accuracy;
use relume::view::Action;
use relume::view::ui::Notice;

use crate::app::{document, wide};

#[test]
fn a_picture_that_nothing_of_the_volume_is_seen_in_says_why_and_what_to_do() {
    let mut thin = document();
    thin.edit(&Edit::Camera(Move::Axis(Side::Front), 1.5));
    thin.edit(&Edit::Crop(Some([DVec3::new(0.0, 0.0, 0.5), DVec3::new(1.0, 1.0, 0.501)])));
    let mut window = wide(thin);
    window.run();
    assert!(window.query_by_label_contains("a thin sheet, seen edge-on").is_some());
    window.get_by_label("Look at its face").click();
    window.run();
    window.run();
    assert!(window.query_by_label_contains("seen edge-on").is_none(), "{:?}", window.state().asked);
    assert!(window.query_by_label_contains("thinner than one step").is_some());
    window.get_by_label("Show the whole axis").click();
    window.run();
    assert!(window.query_by_label_contains("thinner than one step").is_none(), "{:?}", window.state().asked);
    // A thin slab that rays still hit.
    let mut slab = document();
    slab.edit(&Edit::Accuracy(Accuracy { step_length: 0.02, ..slab.state().scene.accuracy.clone() }));
    slab.edit(&Edit::Crop(Some([DVec3::new(0.0, 0.0, 0.5), DVec3::new(1.0, 1.0, 0.52)])));
    let mut window = wide(slab);
    window.run();
    assert!(window.query_by_label_contains("thinner than one step").is_none());
    let mut beside = document();
    beside.edit(&Edit::Camera(Move::Pan { right: 50.0, up: 0.0 }, 1.5));
    let mut window = wide(beside);
    window.run();
    window.get_by_label("Reset the camera").click();
    window.run();
    window.run();
    assert!(window.query_by_label("Reset the camera").is_none());
    assert!(wide(document()).query_by_label("Reset the camera").is_none(), "nothing is said of what is seen");
}

#[test]
fn what_was_done_leaves_by_itself_and_what_went_wrong_stays() {
    let mut window = wide(document());
    let told = |text: &str| Notice::done(text.to_owned());
    window.state_mut().notices = vec![told("The picture is there."), Notice::wrong("It failed.".to_owned())];
    window.run();
    let due = window.output().viewport_output[&egui::ViewportId::ROOT].repaint_delay;
    assert!(due > Duration::from_secs(4) && due <= Duration::from_secs(8), "a window at rest wakes for it: {due:?}");
    let over = |text: &str| Notice { until: Some(Instant::now()), ..told(text) };
    window.state_mut().notices.extend([over("The session is there."), over("Another is there.")]);
    window.run();
    let left: Vec<&str> = window.state().notices.iter().map(|notice| notice.text.as_str()).collect();
    assert_eq!(left, ["The picture is there.", "It failed."]);
}

#[test]
fn a_page_that_is_written_says_how_far_it_is_and_can_be_given_up() {
    let mut window = wide(document());
    window.state_mut().page = Some(("lecture.html".to_owned(), Some(0.4), "comparing all pixels".to_owned()));
    window.run();
    assert!(window.query_by_label("Writing lecture.html: comparing all pixels, 40 %.").is_some());
    window.get_by_label("Cancel").click();
    window.run();
    assert_eq!(window.state().asked.last(), Some(&Action::GiveUpPage));
}
