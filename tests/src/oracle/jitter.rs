//! Where samples lie, and the numbers of rough lobes: twin of `random.glsl`.

use glam::{DVec2, UVec2};

use crate::random::SplitMix64;

/// A projector's state: one word a sample, the high halves of SplitMix64 seeded with the FNV-1a hash of its name.
pub fn seed_words(projector: &str, samples: u32) -> Vec<u32> {
    let mut hash = 0xcbf2_9ce4_8422_2325u64;
    for byte in projector.bytes() {
        hash = (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
    }
    let mut random = SplitMix64(hash);
    (0..samples).map(|_| (random.bits() >> 32) as u32).collect()
}

/// Three hashed words (Jarzynski and Olano, JCGT 9(3), 2020).
pub fn pcg3d(key: [u32; 3]) -> [u32; 3] {
    let [mut x, mut y, mut z] = key.map(|word| word.wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
    let stir = |x: &mut u32, y: &mut u32, z: &mut u32| {
        *x = x.wrapping_add(y.wrapping_mul(*z));
        *y = y.wrapping_add(z.wrapping_mul(*x));
        *z = z.wrapping_add(x.wrapping_mul(*y));
    };
    stir(&mut x, &mut y, &mut z);
    (x, y, z) = (x ^ (x >> 16), y ^ (y >> 16), z ^ (z >> 16));
    stir(&mut x, &mut y, &mut z);
    [x, y, z]
}

fn unit_square(key: [u32; 3]) -> DVec2 {
    let [x, y, _] = pcg3d(key);
    DVec2::new(f64::from(x >> 8), f64::from(y >> 8)) / f64::from(1u32 << 24)
}

/// Where sample `s` of a pixel lies, from the pixel's top left corner: a jittered grid of √n × √n strata (Cook, Porter and
/// Carpenter, SIGGRAPH 1984), or the centre where there is one sample. `seed_words` has a word a sample.
pub fn sample_offset(pixel: UVec2, s: u32, seed_words: &[u32]) -> DVec2 {
    let samples = seed_words.len() as u32;
    if samples == 1 {
        return DVec2::splat(0.5);
    }
    let strata = samples.isqrt();
    let stratum = UVec2::new(s % strata, s / strata).as_dvec2();
    (stratum + unit_square([pixel.x, pixel.y, s ^ seed_words[s as usize]])) / f64::from(strata)
}

/// The two numbers of the ray that is made as number `ray` (from 0) of a sample.
pub fn secondary_random(pixel: UVec2, s: u32, ray: u32, seed_words: &[u32]) -> DVec2 {
    unit_square([pixel.x, pixel.y, ((s << 16) | (ray << 8) | 1) ^ seed_words[s as usize]])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_stratum_has_its_sample() {
        for samples in [4, 9, 16] {
            let words = seed_words("left", samples);
            let strata = samples.isqrt();
            for x in 0..50 {
                for s in 0..samples {
                    let cell = sample_offset(UVec2::new(x, 3 * x), s, &words) * f64::from(strata);
                    assert_eq!(cell.floor().as_uvec2(), UVec2::new(s % strata, s / strata));
                }
            }
        }
        assert_eq!(sample_offset(UVec2::ZERO, 0, &seed_words("left", 1)), DVec2::splat(0.5));
    }

    #[test]
    fn numbers_are_even_and_differ_between_projectors() {
        let (left, right) = (seed_words("left", 4), seed_words("right", 4));
        let count = 4096;
        let at = |i: u32, words: &[u32]| secondary_random(UVec2::new(i % 64, i / 64), 2, 5, words);
        let mean = (0..count).map(|i| at(i, &left)).sum::<DVec2>() / f64::from(count);
        assert!((mean - 0.5).abs().max_element() < 0.02, "{mean}");
        assert!((0..count).all(|i| at(i, &left) != at(i, &right)));
    }
}
