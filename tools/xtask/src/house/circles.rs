//! Circles of a graph: its strongly connected components of more than one node.

use std::collections::{BTreeMap, BTreeSet};

/// Nodes by name, each with those that it leads to.
pub type Graph<N> = BTreeMap<N, BTreeSet<N>>;

/// The circles, each with the edges inside it.
pub fn circles<N: Clone + Ord>(graph: &Graph<N>) -> Vec<Graph<N>> {
    let names: BTreeSet<&N> = graph.iter().flat_map(|(from, to)| std::iter::once(from).chain(to)).collect();
    let names: Vec<&N> = names.into_iter().collect();
    let number: BTreeMap<&N, usize> = names.iter().enumerate().map(|(number, name)| (*name, number)).collect();
    let edges =
        names.iter().map(|name| graph.get(*name).into_iter().flatten().map(|to| number[to]).collect()).collect();
    let mut tarjan = Tarjan { edges, seen: vec![None; names.len()], ..Tarjan::default() };
    for node in 0..names.len() {
        if tarjan.seen[node].is_none() {
            tarjan.visit(node);
        }
    }
    let mut circles: Vec<Graph<N>> = tarjan
        .components
        .iter()
        .filter(|component| component.len() > 1)
        .map(|component| {
            let members: BTreeSet<&N> = component.iter().map(|node| names[*node]).collect();
            let inside = |from: &N| graph[from].iter().filter(|to| members.contains(to)).cloned().collect();
            members.iter().map(|from| ((*from).clone(), inside(from))).collect()
        })
        .collect();
    circles.sort();
    circles
}

/// Tarjan's search (1972) for strongly connected components.
#[derive(Default)]
struct Tarjan {
    edges: Vec<Vec<usize>>,
    /// When a node was first seen.
    seen: Vec<Option<usize>>,
    time: usize,
    /// Nodes that are not yet known to be in a component.
    open: Vec<usize>,
    components: Vec<Vec<usize>>,
}

impl Tarjan {
    /// Visits a node and all that it leads to; the earliest open node that can be had from there.
    fn visit(&mut self, node: usize) -> usize {
        let seen = self.time;
        self.time += 1;
        self.seen[node] = Some(seen);
        let position = self.open.len();
        self.open.push(node);
        let mut earliest = seen;
        for to in self.edges[node].clone() {
            match self.seen[to] {
                None => earliest = earliest.min(self.visit(to)),
                Some(time) if self.open.contains(&to) => earliest = earliest.min(time),
                Some(_) => {}
            }
        }
        if earliest == seen {
            self.components.push(self.open.split_off(position));
        }
        earliest
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn graph(edges: &[(u8, u8)]) -> Graph<u8> {
        let mut graph = Graph::new();
        for (from, to) in edges {
            graph.entry(*from).or_insert_with(BTreeSet::new).insert(*to);
        }
        graph
    }

    #[test]
    fn circles_are_found_with_their_edges_and_nothing_else_is() {
        assert_eq!(circles(&graph(&[(1, 2), (1, 3), (2, 4), (3, 4)])), []);
        // 1, 2, 3 in one with a chord; 5 and 6 in another, which leads to nothing; 4 between them, 7 before both.
        let two = [(1, 2), (2, 3), (3, 1), (1, 3), (3, 4), (4, 5), (5, 6), (6, 5), (7, 1), (7, 6)];
        let first = graph(&[(1, 2), (1, 3), (2, 3), (3, 1)]);
        assert_eq!(circles(&graph(&two)), [first, graph(&[(5, 6), (6, 5)])]);
        // Seen again while open, by a way that began later: all one.
        assert_eq!(circles(&graph(&[(1, 2), (2, 3), (3, 2), (3, 4), (4, 1)])).len(), 1);
    }
}
