// Active Bayesian perception of where and what in plain Rust, after Lepora, Martinez-Hernandez and Prescott,
// "A SOLID case for active Bayesian perception in robot touch", 2013. Answers the conformance cases of this folder:
//
//     rustc -O solid.rs && ./solid < case.jsonl
// Letters are the paper's: L where classes, M what classes, K taxels, J samples of a tap, B bins; indices count from 0.
// Arrays are lists in row order, so class (l, m) is at l * M + m. Beliefs are logarithms.
#![allow(non_snake_case)]
use std::collections::HashMap;

fn refuse(why: &str) -> ! {
    eprintln!("solid: {why}.");
    std::process::exit(2)
}

/// A line of JSON: the words below each key, those of nested lists one after the other; also below "training.taps".
type Line = HashMap<String, Vec<String>>;

/// Takes a value from the beginning of a text and adds it to a line.
fn read(mut line: Line, text: &mut &str, key: &str) -> Line {
    if take(text, '{') {
        while !take(text, '}') {
            let name = word(text);
            take(text, ':');
            line = read(line, text, format!("{key}.{name}").trim_start_matches('.'));
            take(text, ',');
        }
    } else if take(text, '[') {
        while !take(text, ']') {
            line = read(line, text, key);
            take(text, ',');
        }
    } else {
        line.entry(key.to_string()).or_default().push(word(text).to_string());
    }
    line
}

/// Takes a mark from the beginning of a text, if it is there.
fn take(text: &mut &str, mark: char) -> bool {
    let rest = text.trim_start().strip_prefix(mark);
    *text = rest.unwrap_or(text);
    rest.is_some()
}

/// Takes a number, a name such as null, or a string, whose escapes stay.
fn word<'a>(text: &mut &'a str) -> &'a str {
    let (mut quoted, mut escaped) = (false, false);
    let ends = |c: char| {
        quoted ^= c == '"' && !escaped;
        escaped = c == '\\' && !escaped;
        !quoted && ",:[]{} \t\r\n".contains(c)
    };
    let start = text.trim_start();
    let (word, rest) = start.split_at(start.find(ends).unwrap_or(start.len()));
    *text = rest;
    if word.is_empty() { refuse("a line is not JSON") }
    word.strip_prefix('"').and_then(|word| word.strip_suffix('"')).unwrap_or(word)
}

fn text<'a>(line: &'a Line, key: &str) -> &'a str {
    line.get(key).map_or_else(|| refuse(&format!("the key {key:?} is missing")), |words| &words[0])
}

/// So many numbers; any number of them if it is 0.
fn numbers(line: &Line, key: &str, many: usize) -> Vec<f64> {
    let found: Vec<f64> = line.get(key).into_iter().flatten().map(|word| word.parse().unwrap_or(f64::NAN)).collect();
    let right = found.iter().all(|x| x.is_finite()) && (many == 0 || found.len() == many);
    if right { found } else { refuse(&format!("the key {key:?} must hold {many} numbers")) }
}

/// Nested lists of a shape as JSON; minus infinity and no decision are null.
fn nested(values: &[f64], shape: &[usize]) -> String {
    let number = |x: &f64| if x.is_finite() { format!("{x:?}") } else { "null".to_string() };
    let mut parts: Vec<String> = values.iter().map(number).collect();
    for size in shape.iter().rev() {
        parts = parts.chunks(*size).map(|row| format!("[{}]", row.join(","))).collect();
    }
    parts.concat()
}

fn log_sum(logs: impl Iterator<Item = f64> + Clone) -> f64 {
    let top = logs.clone().fold(f64::NEG_INFINITY, f64::max);
    if top.is_finite() { top + logs.map(|x| (x - top).exp()).sum::<f64>().ln() } else { top }
}

/// Bin of a sample; only inner edges are looked at, so that samples outside go to the end bins.
fn bin(sample: f64, edges: &[f64]) -> usize {
    edges[1..edges.len() - 1].partition_point(|&edge| edge <= sample)
}

/// Eq. 7 and 8: the class with the largest marginal, the first of equals, if that is greater than the threshold.
fn decide(marginal: &[f64], threshold: f64) -> Option<usize> {
    let best = (1..marginal.len()).fold(0, |best, i| if marginal[i] > marginal[best] { i } else { best });
    (threshold < 1.0 && marginal[best] > threshold).then_some(best)
}

/// Eq. 9: log belief after a move by d. `to` is the place where belief about each class comes to lie, -1 if it is lost.
fn shifted(old: &[f64], trained: &[bool], d: i64, border: &str, M: usize) -> Vec<f64> {
    let (L, at) = ((old.len() / M) as i64, |l: i64, m: usize| l as usize * M + m);
    let known = |l: i64, m: usize| (0..L).contains(&l) && trained[at(l, m)];
    let near = |l: i64, m: usize| (0..L).filter(|&p| known(p, m)).min_by_key(|p| (p - l).abs()).unwrap_or(l);
    let target = |l: i64, m: usize| match border {
        "circular" => (l + d).rem_euclid(L),
        "clamp" => near((l + d).clamp(0, L - 1), m),
        _ => l + d,
    };
    let cells = (0..old.len()).map(|c| ((c / M) as i64, c % M));
    let to: &Vec<_> = &cells.clone().map(|(l, m)| if known(target(l, m), m) { target(l, m) } else { -1 }).collect();
    let from = |p: i64, m: usize| (0..L).filter(move |&l| known(l, m) && to[at(l, m)] == p);
    let vacated = |m: usize| (0..L).filter(move |&p| known(p, m) && from(p, m).count() == 0);
    let belief = |l: i64, m: usize| log_sum(from(l, m).map(|p| old[at(p, m)]));
    let fill = |l: i64, m: usize| match border {
        "uniform" => log_sum((0..M).map(|m| belief(-1, m))) - ((0..M).flat_map(vacated).count() as f64).ln(),
        "uniform_what" => belief(-1, m) - (vacated(m).count() as f64).ln(),
        "prior" => -(trained.iter().filter(|known| **known).count() as f64).ln(),
        "circular" => from(-1, m).zip(vacated(m)).filter(|pair| pair.1 == l).map(|pair| old[at(pair.0, m)]).sum(),
        _ => f64::NEG_INFINITY,
    };
    let moved = |l: i64, m: usize| if vacated(m).any(|p| p == l) { fill(l, m) } else { belief(l, m) };
    let new: Vec<f64> = cells.map(|(l, m)| moved(l, m)).collect();
    let total = log_sum(new.iter().copied());
    new.iter().map(|log| log - total).collect()
}

/// Edges of all taxels, and probabilities of their bins, [L][M][K][B].
fn model(header: &Line, [L, M, K, J, B]: [usize; 5]) -> (Vec<f64>, Vec<f64>) {
    let key = if header.contains_key("counts") { "counts" } else { "probabilities" };
    let (mut edges, mut table) = (numbers(header, "edges", 0), numbers(header, key, 0));
    if header.contains_key("training.taps") {
        let [taps, l, m] = ["taps", "where", "what"].map(|key| numbers(header, &format!("training.{key}"), 0));
        let (low, high) = taps.iter().fold((f64::MAX, f64::MIN), |(low, high), &z| (z.min(low), z.max(high)));
        edges = (0..=B).map(|b| if b < B { low + (high - low) * b as f64 / B as f64 } else { high }).collect();
        table = vec![0.0; L * M * K * B];
        for (i, z) in taps.iter().enumerate() {
            let class = l[i / (J * K)] as usize * M + m[i / (J * K)] as usize;
            table[(class * K + i % K) * B + bin(*z, &edges)] += 1.0;
        }
        let (case, h) = (text(header, "case"), nested(&table, &[L, M, K, B]));
        println!(r#"{{"case":"{case}","tap":0,"edges":{},"counts":{h}}}"#, nested(&edges, &[B + 1]));
    }
    if !header.contains_key("probabilities") {
        let pseudocount = numbers(header, "pseudocount", 1)[0];
        for histogram in table.chunks_mut(B) {
            let total: f64 = histogram.iter().map(|h| h + pseudocount).sum();
            histogram.iter_mut().for_each(|h| *h = (*h + pseudocount) / total); // Eq. 2
        }
    }
    (if edges.len() == B + 1 { edges.repeat(K) } else { edges }, table)
}

/// Answers the taps of a case.
fn play(header: &Line, taps: impl Iterator<Item = Line>) {
    let sizes = ["L", "M", "K", "J", "B"].map(|key| numbers(header, key, 1)[0] as usize);
    let ([L, M, K, J, B], (edges, table)) = (sizes, model(header, sizes));
    if text(header, "format") != "1" || header.get("saturation").is_some_and(|words| words[0] != "null") {
        refuse("\"format\" must be 1 and \"saturation\" null")
    }
    let [case, border, power] = ["case", "border", "power"].map(|key| text(header, key));
    let [theta_x, fixation] = ["theta_x", "fixation"].map(|key| numbers(header, key, 1)[0]);
    let trained: Vec<bool> = table.chunks(K * B).map(|class| class.iter().any(|p| *p > 0.0)).collect();
    let log_table: Vec<f64> = table.iter().map(|p| p.ln()).collect();
    let mut log_belief: Vec<f64> = numbers(header, "prior", L * M).iter().map(|p| p.ln()).collect();
    let root = match power { "J" => J, "JK" => J * K, "none" => 1, _ => 0 };
    let exponent = if root > 0 { 1.0 / root as f64 } else { numbers(header, "power", 1)[0] };
    for line in taps {
        let ([tap, d], z) = (["tap", "move"].map(|key| numbers(&line, key, 1)[0]), numbers(&line, "samples", J * K));
        if d != 0.0 { log_belief = shifted(&log_belief, &trained, d as i64, border, M) }
        let cell = |i: usize| i % K * B + bin(z[i], &edges[i % K * (B + 1)..][..B + 1]);
        let cells: Vec<usize> = (0..J * K).map(cell).collect();
        let product = |class: &[f64]| exponent * cells.iter().map(|&c| class[c]).sum::<f64>();
        let log_likelihood: Vec<f64> = log_table.chunks(K * B).map(product).collect(); // Eq. 1
        let joint: Vec<f64> = log_belief.iter().zip(&log_likelihood).map(|(a, b)| a + b).collect();
        let log_evidence = log_sum(joint.iter().copied()); // Eq. 4
        if log_evidence == f64::NEG_INFINITY {
            return println!(r#"{{"case":"{case}","tap":{tap},"error":"zero_evidence"}}"#);
        }
        log_belief = joint.iter().map(|log| log - log_evidence).collect(); // Eq. 3
        let belief: Vec<f64> = log_belief.iter().map(|log| log.exp()).collect();
        let place: Vec<f64> = belief.chunks(M).map(|row| row.iter().sum()).collect(); // Eq. 5
        let object: Vec<f64> = (0..M).map(|m| belief.iter().skip(m).step_by(M).sum()).collect(); // Eq. 6
        let decided = |theta: &f64| decide(&object, *theta).map_or(f64::NAN, |m| m as f64);
        let decisions: Vec<f64> = numbers(header, "thresholds", 0).iter().map(decided).collect(); // Eq. 7
        let step = decide(&place, theta_x).map_or(0, |l| fixation as i64 - l as i64); // Eq. 10
        let [likelihood, posterior] = [&log_likelihood, &belief].map(|rows| nested(rows, &[L, M]));
        let [place, object, decisions] = [&place, &object, &decisions].map(|list| nested(list, &[list.len()]));
        print!(r#"{{"case":"{case}","tap":{tap},"log_likelihood":{likelihood},"log_evidence":{log_evidence:?},"#);
        print!(r#""posterior":{posterior},"where":{place},"what":{object},"#);
        println!(r#""decisions":{decisions},"move":{step}}}"#);
    }
}

fn main() {
    let texts = std::io::stdin().lines().map(|text| text.expect("Lines are text in UTF-8."));
    let mut lines = texts.map(|text| read(Line::new(), &mut text.as_str(), "")).peekable();
    while let Some(header) = lines.next() {
        play(&header, std::iter::from_fn(|| lines.next_if(|line| line.contains_key("tap"))));
        while lines.next_if(|line| line.contains_key("tap")).is_some() {} // behind an impossible one
    }
}
