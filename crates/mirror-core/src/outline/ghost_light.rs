//! A picture's light without the ghost of a pane, as levels.

/// The level of light without a ghost: `(P − r (P₁ − r P₂)) (1 + r)`, P the light of a picture, P₁ and P₂ that of the picture moved once and twice as far as the ghost
/// lies, r its strength against the rest. `levels` are those of light in even steps from 0 to 1; light beyond has those of its ends.
pub fn without_ghost(light: [&[f32]; 3], ratio: f32, brighter: f32, levels: &[u8], to: &mut Vec<u8>) {
    let [own, once, twice] = light;
    let last = levels.len().saturating_sub(1);
    let steps = last as f32;
    to.extend(own.iter().zip(once).zip(twice).filter_map(|((own, once), twice)| {
        let alone = (own - ratio * (once - ratio * twice)) * brighter;
        // (A float beyond a whole number's range becomes the nearest one.)
        levels.get(((alone * steps + 0.5) as u32 as usize).min(last)).copied()
    }));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_with_its_ghost_becomes_the_picture_alone() {
        let levels: Vec<u8> = (0..=200).collect();
        let (share, scene) = (0.1f32, [0.2f32, 0.6, 0.4, 0.4, 0.4]);
        // The ghost lies one place on; the scene goes on as it begins.
        let before = |i: usize, by: usize| scene[i.saturating_sub(by)];
        let seen = |i: usize| (1.0 - share) * before(i, 0) + share * before(i, 1);
        let moved = |by: usize| -> Vec<f32> { (0..5usize).map(|i| seen(i.saturating_sub(by))).collect() };
        let (ratio, mut found) = (share / (1.0 - share), Vec::new());
        without_ghost([&moved(0), &moved(1), &moved(2)], ratio, 1.0 + ratio, &levels, &mut found);
        let wanted: Vec<u8> = scene.iter().map(|light| (light * 200.0).round() as u8).collect();
        assert!(found.iter().zip(&wanted).all(|(a, b)| a.abs_diff(*b) <= 1), "{found:?} {wanted:?}");
        let mut ends = Vec::new();
        without_ghost([&[-1.0, 2.0], &[0.0; 2], &[0.0; 2]], 0.0, 1.0, &levels, &mut ends);
        assert_eq!(ends, [0, 200]);
    }
}
