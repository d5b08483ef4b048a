//! Colours: sRGB bytes and linear light (IEC 61966-2-1).

/// Linear light of an sRGB colour.
pub fn linear(srgb: [u8; 3]) -> [f32; 3] {
    srgb.map(|byte| {
        let c = f32::from(byte) / 255.0;
        if c <= 0.04045 {
            c / 12.92
        } else {
            ((c + 0.055) / 1.055).powf(2.4)
        }
    })
}

/// The sRGB byte of linear light, 0 to 1; what is beyond that is cut.
pub fn byte(linear: f32) -> u8 {
    let c = linear.clamp(0.0, 1.0);
    let s = if c <= 0.003_130_8 {
        12.92 * c
    } else {
        1.055 * c.powf(1.0 / 2.4) - 0.055
    };
    (s * 255.0).round() as u8
}

/// `0xRRGGBB` as bytes.
pub fn bytes_of(colour: u32) -> [u8; 3] {
    let [_, r, g, b] = colour.to_be_bytes();
    [r, g, b]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_come_back_and_mid_grey_is_a_fifth_of_the_light() {
        for b in 0..=255 {
            assert_eq!(linear([b; 3]).map(byte), [b; 3]);
        }
        assert_eq!((byte(-1.0), byte(0.214_041), byte(2.0)), (0, 127, 255));
        assert_eq!(bytes_of(0x2f_6f_73), [0x2f, 0x6f, 0x73]);
    }
}
