//! Affine maps between systems of a few axes, in the order of the document. Costs a number for each pair of axes.

/// A map from some axes to others: a row for each of the latter, of a factor for each of the former, and an offset.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Affine {
    rows: Vec<Vec<f64>>,
    inputs: usize,
}

impl Affine {
    /// The map that changes nothing.
    pub(super) fn identity(axes: usize) -> Self {
        Self::scale(&vec![1.0; axes])
    }

    pub(super) fn scale(factors: &[f64]) -> Self {
        let mut map = Self { rows: vec![vec![0.0; factors.len() + 1]; factors.len()], inputs: factors.len() };
        map.rows.iter_mut().zip(factors).enumerate().for_each(|(axis, (row, factor))| row[axis] = *factor);
        map
    }

    pub(super) fn translation(offsets: &[f64]) -> Self {
        let mut map = Self::identity(offsets.len());
        map.rows.iter_mut().zip(offsets).for_each(|(row, offset)| row[offsets.len()] = *offset);
        map
    }

    /// Creates a map of rows with the offset at their end; `None` unless each has a number more than there are inputs.
    pub(super) fn of_rows(rows: Vec<Vec<f64>>, inputs: usize) -> Option<Self> {
        rows.iter().all(|row| row.len() == inputs + 1).then_some(Self { rows, inputs })
    }

    /// A map whose output `i` is the input `order[i]`; `None` if there is no such input.
    pub(super) fn permutation(order: &[usize]) -> Option<Self> {
        let mut map = Self { rows: vec![vec![0.0; order.len() + 1]; order.len()], inputs: order.len() };
        for (row, from) in map.rows.iter_mut().zip(order) {
            *row.get_mut(*from).filter(|_| *from < order.len())? = 1.0;
        }
        Some(map)
    }

    pub(super) fn inputs(&self) -> usize {
        self.inputs
    }

    pub(super) fn outputs(&self) -> usize {
        self.rows.len()
    }

    /// The factor of an input in an output.
    pub(super) fn factor(&self, output: usize, input: usize) -> f64 {
        self.rows[output][input]
    }

    pub(super) fn offset(&self, output: usize) -> f64 {
        self.rows[output][self.inputs]
    }

    /// This map, and `next` after it; `None` if `next` has another number of inputs, or a number becomes infinite.
    pub(super) fn then(&self, next: &Self) -> Option<Self> {
        if next.inputs != self.outputs() {
            return None;
        }
        let mut rows = vec![vec![0.0; self.inputs + 1]; next.outputs()];
        for (row, factors) in rows.iter_mut().zip(&next.rows) {
            for (of_input, factor) in self.rows.iter().zip(factors) {
                row.iter_mut().zip(of_input).for_each(|(sum, number)| *sum += factor * number);
            }
            row[self.inputs] += factors[next.inputs];
        }
        let is_finite = rows.iter().flatten().all(|number| number.is_finite());
        is_finite.then_some(Self { rows, inputs: self.inputs })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn maps_follow_one_another() {
        let map = Affine::scale(&[2.0, 3.0]).then(&Affine::translation(&[10.0, -1.0])).unwrap();
        assert_eq!(map, Affine::of_rows(vec![vec![2.0, 0.0, 10.0], vec![0.0, 3.0, -1.0]], 2).unwrap());
        // The offset is scaled, too, where it comes first.
        let map = Affine::translation(&[10.0, -1.0]).then(&Affine::scale(&[2.0, 3.0])).unwrap();
        assert_eq!((map.offset(0), map.offset(1), map.factor(1, 1)), (20.0, -3.0, 3.0));
        let swapped = Affine::permutation(&[1, 0]).unwrap();
        assert_eq!(map.then(&swapped).unwrap().offset(0), -3.0);
        assert_eq!(Affine::permutation(&[0, 2]), None);
        assert_eq!(map.then(&Affine::identity(3)), None);
        assert_eq!(Affine::scale(&[1e200]).then(&Affine::scale(&[1e200])), None);
        let wider = Affine::of_rows(vec![vec![1.0, 0.0], vec![0.0, 5.0]], 1).unwrap();
        assert_eq!((wider.inputs(), wider.outputs()), (1, 2));
    }
}
