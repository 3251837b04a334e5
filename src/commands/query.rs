//! `bake query`: questions on standard input, one JSON object a line, and their answers on standard output.

use super::find_subject;
use crate::arguments::QueryOptions;
use crate::output;
use anyhow::{Context, Result, bail};
use bake_runtime::query::{Row, Subject, answered};
use rayon::prelude::*;
use std::io::{self, BufRead, BufReader};

/// Bytes that are read at once from a file; a pipe gives what is there.
const BUFFER: usize = 1 << 18;

/// Rows that are answered side by side before any of them is printed.
const ROWS: usize = 256;

/// Runs the command.
pub fn run(options: &QueryOptions) -> Result<()> {
    let subject = find_subject(&options.subject)?;
    let mut input = BufReader::with_capacity(BUFFER, io::stdin());
    let mut unread = Vec::new();
    let mut number = 0;
    loop {
        // Whatever lines are there are answered before more is waited for, so that a program can converse.
        let available = input.fill_buf().context("standard input")?;
        let (length, ended) = (available.len(), available.is_empty());
        unread.extend_from_slice(available);
        input.consume(length);
        let whole = match ended {
            true => unread.len(),
            false => unread.iter().rposition(|b| *b == b'\n').map_or(0, |i| i + 1),
        };
        let lines: Vec<&[u8]> = unread[..whole].split_inclusive(|b| *b == b'\n').collect();
        for rows in lines.chunks(ROWS) {
            if !answer(&subject, rows, number, options.seed)? {
                return Ok(());
            }
            number += rows.len();
        }
        unread.drain(..whole);
        if ended {
            return Ok(());
        }
    }
}

/// Prints the answers to `rows`, of which `before` lines came before; false when nobody listens any more.
fn answer(subject: &Subject, rows: &[&[u8]], before: usize, seed: u64) -> Result<bool> {
    let answers: Vec<Result<String>> = rows
        .par_iter()
        .map(|line| answer_line(subject, line, seed))
        .collect();
    let mut text = String::new();
    let mut mistake = None;
    for (i, answer) in answers.into_iter().enumerate() {
        match answer {
            Ok(line) => text.push_str(&line),
            Err(error) => {
                mistake = Some((before + i + 1, error));
                break;
            }
        }
    }
    if !output::stream(&text)? {
        return Ok(false);
    }
    match mistake {
        Some((number, error)) => bail!("standard input, line {number}: {error}"),
        None => Ok(true),
    }
}

/// The answer to one line; blank lines are passed over.
fn answer_line(subject: &Subject, line: &[u8], seed: u64) -> Result<String> {
    let line = std::str::from_utf8(line).context("not UTF-8")?.trim();
    if line.is_empty() {
        return Ok(String::new());
    }
    let answer = subject.answer(&Row::parse(line)?, seed)?;
    Ok(answered(line, &answer)? + "\n")
}
