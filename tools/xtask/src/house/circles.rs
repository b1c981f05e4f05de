//! Circles of a graph: its strongly connected components of more than one node.

use std::collections::{BTreeMap, BTreeSet};

/// Nodes by name, each with those that it leads to.
pub type Graph<N> = BTreeMap<N, BTreeSet<N>>;

/// The circles, each with the edges inside it.
pub fn find_strongly_connected_components_of_several_nodes<N: Clone + Ord>(graph: &Graph<N>) -> Vec<Graph<N>> {
    // With some hundred nodes, which one leads to which is found by plain search.
    let reached: BTreeMap<&N, BTreeSet<&N>> =
        graph.keys().map(|start| (start, find_reachable_by_one_or_more_edges(graph, start))).collect();
    let leads_to = |from: &N, to: &N| reached.get(from).is_some_and(|nodes| nodes.contains(to));
    let circle_of = |node: &N| -> BTreeSet<&N> {
        graph.keys().filter(|other| *other == node || leads_to(node, other) && leads_to(other, node)).collect()
    };
    let circles: BTreeSet<BTreeSet<&N>> = graph.keys().map(circle_of).filter(|nodes| nodes.len() > 1).collect();
    let with_edges = |nodes: &BTreeSet<&N>| -> Graph<N> {
        let inside = |from: &N| graph[from].iter().filter(|to| nodes.contains(to)).cloned().collect();
        nodes.iter().map(|from| ((*from).clone(), inside(from))).collect()
    };
    circles.iter().map(with_edges).collect()
}

/// The nodes to which at least one edge leads from `start`, directly or through others.
fn find_reachable_by_one_or_more_edges<'a, N: Ord>(graph: &'a Graph<N>, start: &'a N) -> BTreeSet<&'a N> {
    let (mut reached, mut open) = (BTreeSet::new(), vec![start]);
    while let Some(node) = open.pop() {
        open.extend(graph.get(node).into_iter().flatten().filter(|next| reached.insert(*next)));
    }
    reached
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
        assert_eq!(find_strongly_connected_components_of_several_nodes(&graph(&[(1, 2), (1, 3), (2, 4), (3, 4)])), []);
        // 1, 2, 3 in one with a chord; 5 and 6 in another, which leads to nothing; 4 between them, 7 before both.
        let two = [(1, 2), (2, 3), (3, 1), (1, 3), (3, 4), (4, 5), (5, 6), (6, 5), (7, 1), (7, 6)];
        let first = graph(&[(1, 2), (1, 3), (2, 3), (3, 1)]);
        assert_eq!(
            find_strongly_connected_components_of_several_nodes(&graph(&two)),
            [first, graph(&[(5, 6), (6, 5)])]
        );
        // Seen again while open, by a way that began later: all one.
        assert_eq!(
            find_strongly_connected_components_of_several_nodes(&graph(&[(1, 2), (2, 3), (3, 2), (3, 4), (4, 1)]))
                .len(),
            1
        );
    }
}
