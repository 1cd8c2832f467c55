//! The read-out under the pointer: the whole values for which a line has room. A number cut short is another number.

/// The place under the pointer, and the values there.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct ReadOut {
    /// The place in the world.
    pub(crate) place: String,
    /// The values, each after its separating space and voxel.
    pub(crate) values: Vec<String>,
}

impl ReadOut {
    pub(crate) fn all(&self) -> String {
        self.place.clone() + &self.values.concat()
    }

    /// The place and the values for which there is room, and the count of the others. The place goes before the first value.
    pub(crate) fn fitting(&self, has_room: impl Fn(&str) -> bool) -> String {
        let count = self.values.len();
        let values = |shown: usize| {
            let more = if shown < count { format!("  +{}", count - shown) } else { String::new() };
            self.values[..shown].concat() + &more
        };
        let least = count.min(1);
        let fitting =
            (least..=count).rev().map(|shown| self.place.clone() + &values(shown)).find(|text| has_room(text));
        fitting.unwrap_or_else(|| if count == 0 { self.place.clone() } else { values(least).trim_start().into() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_that_have_no_room_are_counted() {
        let values = ["  voxel 3, 4, 5: a 21", " 22", "  b 7"].map(String::from).into();
        let read_out = ReadOut { place: "at 3, 4, 5 mm".into(), values };
        let within = |most: usize| read_out.fitting(|text| text.len() <= most);
        assert_eq!(within(50), read_out.all());
        assert_eq!(within(41), "at 3, 4, 5 mm  voxel 3, 4, 5: a 21 22  +1");
        assert_eq!(within(40), "at 3, 4, 5 mm  voxel 3, 4, 5: a 21  +2");
        assert_eq!(within(30), "voxel 3, 4, 5: a 21  +2");
        assert_eq!(ReadOut { values: Vec::new(), ..read_out }.fitting(|_| false), "at 3, 4, 5 mm");
    }
}
