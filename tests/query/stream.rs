//! Rows in, rows out: answers come while questions are still written, and nobody needs to listen.

use crate::PATIENCE;
use crate::program::{Studio, finish};
use std::io::{BufRead, BufReader, Write};
use std::process::Stdio;
use std::sync::mpsc;
use std::time::Duration;

#[test]
fn a_conversation_gets_every_answer_at_once() {
    let studio = Studio::new();
    let mut command = studio.bake(&["query", "vase"]);
    let mut child = command.stdin(Stdio::piped()).spawn().expect("the program starts");
    let mut stdin = child.stdin.take().expect("it is piped");
    let stdout = BufReader::new(child.stdout.take().expect("it is piped"));
    let (sender, receiver) = mpsc::channel();
    let reader = std::thread::spawn(move || {
        for line in stdout.lines() {
            drop(sender.send(line.expect("answers are UTF-8")));
        }
    });
    for theta in [10, 50, 80] {
        // In two parts: half a line is no question yet.
        write!(stdin, r#"{{"wo": [{theta}, 0], "#).expect("it listens");
        stdin.flush().expect("it listens");
        std::thread::sleep(Duration::from_millis(20));
        writeln!(stdin, r#""albedo": true}}"#).expect("it listens");
        stdin.flush().expect("it listens");
        let answer = receiver
            .recv_timeout(PATIENCE)
            .expect("an answer before the next question");
        assert!(answer.contains(&format!(r#""wo": [{theta}, 0]"#)), "{answer}");
    }
    // The last line needs no end.
    write!(stdin, "\n{{\"wo\": [1, 0], \"albedo\": true}}").expect("it listens");
    drop(stdin);
    assert!(
        receiver
            .recv_timeout(PATIENCE)
            .expect("the last answer")
            .contains(r#""wo": [1, 0]"#)
    );
    let status = child.wait().expect("the child is ours");
    assert!(status.success(), "{status}");
    reader.join().expect("it does not panic");
}

#[test]
fn nobody_listening_is_no_failure() {
    let studio = Studio::new();
    let mut command = studio.bake(&["query", "vase"]);
    let mut child = command.stdin(Stdio::piped()).spawn().expect("the program starts");
    drop(child.stdout.take());
    let mut stdin = child.stdin.take().expect("it is piped");
    let rows = "{\"wo\": [10, 0], \"wi\": [20, 0], \"samples\": 2}\n".repeat(20_000);
    // It may stop reading at any row.
    drop(stdin.write_all(rows.as_bytes()));
    drop(stdin);
    let output = finish(child, PATIENCE);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && errors.is_empty(), "{errors}");
}
