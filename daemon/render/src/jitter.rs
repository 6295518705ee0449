//! The state from which shaders make their random numbers.

/// The random state of a projector: one word a sample, from its name, so that the same scene gives the same image.
pub(crate) fn sample_state(name: &str, samples: u32) -> Vec<u32> {
    // FNV-1a for the name, SplitMix64 (Steele, Lea and Flood, OOPSLA 2014) for the words.
    let mut state =
        name.bytes().fold(0xcbf2_9ce4_8422_2325_u64, |h, b| (h ^ u64::from(b)).wrapping_mul(0x100_0000_01b3));
    (0..samples)
        .map(|_| {
            state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let mut z = state;
            z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            ((z ^ (z >> 31)) >> 32) as u32
        })
        .collect()
}
