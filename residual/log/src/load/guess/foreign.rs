//! On how many files of other programs the first model file runs at once.

use super::guess;
use crate::spec::Spec;

/// Rows of a log.
const ROWS: usize = 300;

/// Files of a set. The model file must run on the first try on all of them.
const ALL: usize = 25;

/// A log of another program: what it stands for, the name of its file, its bytes.
type Foreign = (&'static str, &'static str, Vec<u8>);

/// Time in s, command and force in N, speed in rad/s, angle in rad.
fn at(i: usize) -> [f64; 5] {
    let t = 0.01 * i as f64;
    let angle = 2.0 * (1.3 * t).sin() + (2.9 * t).cos();
    let speed = 2.6 * (1.3 * t).cos() - 2.9 * (2.9 * t).sin();
    let command = 4.0 + 2.0 * (3.0 * t).sin();
    let force = command - 0.4 * speed.signum() + 0.01 * (i * i % 7) as f64;
    [t, command, speed, angle, force]
}

/// Lines of a log, by the values of each row.
fn lines(line: impl Fn(usize, [f64; 5]) -> String) -> String {
    (0..ROWS).map(|i| line(i, at(i)) + "\n").collect()
}

/// Cells with a separator between them.
fn cells(values: &[f64], between: &str) -> String {
    let all: Vec<String> = values.iter().map(|v| format!("{v:.5}")).collect();
    all.join(between)
}

fn plain(head: &str, between: &str) -> String {
    format!("{head}\n{}", lines(|_, v| cells(&v, between)))
}

/// A text in the old code of western Europe.
fn cp1252(text: &str) -> Vec<u8> {
    text.chars()
        .map(|c| u8::try_from(u32::from(c)).unwrap_or(b'?'))
        .collect()
}

fn texts() -> Vec<Foreign> {
    let comma = "t,command,speed,angle,force";
    let german =
        "Zeit [s];Sollkraft [N];Geschwindigkeit [rad/s];Winkel [rad];Kraft [N]".to_string();
    let decimal_comma = |head: &str| plain(head, ";").replace('.', ",");
    let clock = |t: f64| {
        let s = 3590.0 + t;
        let (minute, second) = ((s / 60.0) as usize, s % 60.0);
        format!("{:02}:{:02}:{second:06.3}", 22 + minute / 60, minute % 60)
    };
    let labview = |x: &str| {
        let x_value = |i: usize| match x {
            "No" => String::new(),
            _ => format!("{:.6}", 0.01 * i as f64),
        };
        format!(
            "LabVIEW Measurement\t\nWriter_Version\t2\nReader_Version\t2\nSeparator\tTab\nDecimal_Separator\t.\nMulti_Headings\tYes\n\
             X_Columns\t{x}\nTime_Pref\tRelative\n***End_of_Header***\t\n\nChannels\t4\t\t\t\t\nSamples\t{ROWS}\t{ROWS}\t{ROWS}\t{ROWS}\t\n\
             Delta_X\t0.010000\t0.010000\t0.010000\t0.010000\t\n***End_of_Header***\t\t\t\t\t\nX_Value\tcommand\tspeed\tangle\tforce\tComment\n{}",
            lines(|i, v| format!("{}\t{}\t", x_value(i), cells(&v[1..], "\t")))
        )
    };
    let text = |what, name, text: String| (what, name, text.into_bytes());
    vec![
        text("commas", "a.csv", plain(comma, ",")),
        text("tabs and CR LF", "a.txt", plain(&comma.replace(',', "\t"), "\t").replace('\n', "\r\n")),
        text("a byte order mark", "a.csv", format!("\u{feff}{}", plain(comma, ","))),
        text("semicolons and decimal commas", "a.csv", decimal_comma(&comma.replace(',', ";"))),
        text("German names and units", "a.csv", decimal_comma(&german)),
        (
            "German names in cp1252",
            "a.csv",
            cp1252(&decimal_comma("Prüfzeit;Sollkraft;Geschwindigkeit;Winkel;Prüfkraft\ns;N;rad/s;rad;N")),
        ),
        text("LabVIEW with times", "a.lvm", labview("One")),
        text("LabVIEW without times", "a.lvm", labview("No")),
        text(
            "a header with more cells than rows",
            "a.csv",
            format!("{comma},comment,flag\n{}", lines(|_, v| cells(&v, ","))),
        ),
        text(
            "rows that end with a separator",
            "a.csv",
            format!("{comma}\n{}", lines(|_, v| cells(&v, ",") + ",")),
        ),
        text("names that repeat", "a.csv", plain("Time,Force,Speed,Angle,Force", ",")),
        text("an oscilloscope", "a.csv", plain("x-axis,1,2,3,4\nsecond,Volt,Volt,Volt,Volt", ",")),
        text(
            "a date and a time of day",
            "a.csv",
            format!(
                "Date,Time,command,speed,angle,force\n{}",
                lines(|_, v| format!("2026-03-04,{},{}", clock(v[0]), cells(&v[1..], ",")))
            ),
        ),
        text(
            "times of day",
            "a.csv",
            format!("time,command,speed,angle,force\n{}", lines(|_, v| format!("{},{}", clock(v[0]), cells(&v[1..], ",")))),
        ),
        text(
            "stamps with a zone",
            "a.csv",
            format!(
                "timestamp,command,speed,angle,force\n{}",
                lines(|_, v| format!("2026-03-04T{}+01:00,{}", clock(v[0]), cells(&v[1..], ",")))
            ),
        ),
        text(
            "milliseconds since 1970",
            "a.csv",
            format!(
                "timestamp_ms,command,speed,angle,force\n{}",
                lines(|i, v| format!("{},{}", 1_770_000_000_000_u64 + 10 * i as u64, cells(&v[1..], ",")))
            ),
        ),
        text(
            "seconds and nanoseconds beside a counter",
            "a.csv",
            format!(
                "header.seq,header.stamp.secs,header.stamp.nsecs,header.frame_id,command,speed,angle,force\n{}",
                lines(|i, v| format!("{i},{},{},base,{}", 1_770_000_000 + i / 100, i % 100 * 10_000_000, cells(&v[1..], ",")))
            ),
        ),
        text(
            "labels in each row",
            "putty.log",
            format!(
                "10:10:59.100 -> ready\n{}",
                lines(|_, [t, c, s, _, f]| format!("10:11:{t:06.3} -> cmd: {c:.3} N, speed: {s:.3} rad/s, force: {f:.3} N"))
            ),
        ),
        text(
            "blanks and a header in a comment",
            "a.dat",
            format!("% made by a script\n% t command speed angle force\n{}", lines(|_, v| cells(&v, "  "))),
        ),
        text("no header", "a.txt", lines(|_, v| cells(&v, " "))),
        text(
            "quotation marks",
            "a.csv",
            format!(
                "\"t\",\"command, N\",\"speed\",\"angle\",\"force\"\n{}",
                lines(|_, v| format!("\"{}\"", cells(&v, "\",\"")))
            ),
        ),
        text(
            "lines about the test above the names",
            "a.csv",
            format!("Specimen: 12\nOperator: A. B.\nDate: 2026-03-04\n\n{}", plain("Time (s),Command (N),Speed (rad/s),Angle (rad),Force (N)", ",")),
        ),
        text(
            "topics in turn, with empty cells",
            "a.csv",
            format!(
                "__time,/rig/command,/rig/velocity,/rig/position,/rig/force\n{}",
                lines(|i, v| match i % 3 {
                    2 => format!("{:.5},,,,", v[0]),
                    _ => cells(&v, ","),
                })
            ),
        ),
        text(
            "words in cells",
            "a.csv",
            format!(
                "t,state,command,speed,angle,force\n{}",
                lines(|i, v| format!("{:.5},{},{}", v[0], ["run", "hold"][i / 150], cells(&v[1..], ",")))
            ),
        ),
    ]
}

/// Files of further kinds, made after the first model file ran on those above.
fn further() -> Vec<Foreign> {
    let names = "time,command,velocity,force";
    let four = |[t, c, v, _, f]: [f64; 5]| [t, c, v, f];
    let point = |v: [f64; 5]| cells(&four(v), ",");
    let comma = |v: [f64; 5]| cells(&four(v), ";").replace('.', ",");
    let rest = |v: [f64; 5]| cells(&four(v)[1..], ",");
    let of =
        |head: &str, line: &dyn Fn(usize, [f64; 5]) -> String| format!("{head}\n{}", lines(line));
    // The time of day of a row, from ten in the morning on.
    let clock = |t: f64| format!("10:00:{t:06.3}");
    // A number with marks between its thousands.
    let thousands = |x: f64| {
        let text = format!("{:.2}", 1000.0 * x.abs());
        let (whole, fraction) = text.split_once('.').unwrap();
        let at = whole.len().saturating_sub(3);
        let groups = if at > 0 {
            format!("{}.{}", &whole[..at], &whole[at..])
        } else {
            whole.into()
        };
        format!("{}{groups},{fraction}", if x < 0.0 { "-" } else { "" })
    };
    let text = |what, name, text: String| (what, name, text.into_bytes());
    vec![
        text("a spreadsheet's `sep=;`", "a.csv", format!("\u{feff}sep=;\r\n{}", of("Zeit;Sollkraft (N);Drehzahl (1/min);Kraft (N)", &|_, v| comma(v)))),
        text("an American date with AM and PM", "a.csv", of(names, &|_, v| format!("3/14/2026 {} AM,{}", clock(v[0]), rest(v)))),
        text("a European date with slashes", "a.csv", of("Fecha;Consigna;Velocidad;Fuerza", &|_, v| format!("14/03/2026 {};{}", clock(v[0]).replace('.', ","), cells(&four(v)[1..], ";").replace('.', ",")))),
        text("a date with the month as a word", "a.csv", of(names, &|_, v| format!("14-Mar-2026 {},{}", clock(v[0]), rest(v)))),
        text("a date without marks", "a.csv", of("utc,command,velocity,force", &|_, v| format!("20260314T{}Z,{}", clock(v[0]).replace(':', ""), rest(v)))),
        text("a colon before thousandths", "a.csv", of(names, &|_, v| format!("{},{}", clock(v[0]).replace('.', ":"), rest(v)))),
        text("days of a spreadsheet", "a.csv", of("Date;Command;Velocity;Force", &|_, v| format!("{:.11};{}", 46_148.5 + v[0] / 86_400.0, cells(&four(v)[1..], ";")))),
        text("marks between thousands", "a.csv", of("Zeit;Befehl;Geschwindigkeit;Kraft\ns;mN;rad/s;mN", &|_, [t, c, v, _, f]| format!("{};{};{};{}", format!("{t:.2}").replace('.', ","), thousands(c), format!("{v:.4}").replace('.', ","), thousands(f)))),
        text("decimal commas in quotation marks", "a.csv", of("\"Zeit\",\"Befehl\",\"Geschwindigkeit\",\"Kraft\"", &|_, v| format!("\"{}\"", comma(v).replace(';', "\",\"")))),
        text("units in each cell", "a.csv", of(names, &|_, [t, c, v, _, f]| format!("{t:.2} sec,{c:.4} N,{v:.4} rad/s,{f:.4} N"))),
        text("a name before each value", "a.log", lines(|_, [t, c, v, _, f]| format!("t={t:.3} cmd={c:.4} vel={v:.4} force={f:.4}"))),
        text("names of rows without a name", "a.txt", of("\"time\" \"command\" \"velocity\" \"force\"", &|i, v| format!("\"{}\" {}", i + 1, cells(&four(v), " ")))),
        text("an index without a name", "a.csv", of(",time,command,velocity,force", &|i, v| format!("{i},{}", point(v)))),
        text("an oscilloscope's step beside the names", "a.csv", of("X,CH1,CH2,CH3,Start,Increment,\nSequence,Volt,Volt,Volt,-1.0e+00,1.0e-02", &|i, v| format!("{i},{},", rest(v)))),
        text("a time for each channel", "a.csv", of("Name;axis 1\nFile;a.csv\n\nName;F set;Name;speed;Name;force\nSampleTime[ms];10;SampleTime[ms];10;SampleTime[ms];10\nData-Type;REAL64;Data-Type;REAL64;Data-Type;REAL64\n", &|i, [_, c, v, _, f]| format!("{0};{c:.4};{0};{v:.4};{0};{f:.4}", 10 * i))),
        text("a header behind slashes", "a.txt", of("// logger 2\n// t[ms] cmd[N] vel[rad/s] f[N]", &|i, v| format!("{} {}", 10 * i, cells(&four(v)[1..], " ")))),
        text("lines that end with a carriage return", "a.csv", of(names, &|_, v| point(v)).replace('\n', "\r")),
        text("a time in minutes", "a.txt", of("  Time/min   Cmd/N   Vel/(rad/s)  Force/N", &|_, v| format!("{:12.8} {}", v[0] / 60.0, cells(&four(v)[1..], " ")))),
        text("exponents of Fortran", "a.dat", of("  TIME  CMD  VEL  FORCE", &|_, v| four(v).map(|x| format!("{x:.6E}").replace('E', "D")).join("  "))),
        text("a minus of set type", "a.csv", of(names, &|_, v| point(v).replace('-', "\u{2212}"))),
        text("words for missing values", "a.csv", of(names, &|i, v| match i % 40 {
            39 => format!("{},{}", cells(&four(v)[..3], ","), ["#N/A", "---", "n/a", "NULL", "?"][i / 40 % 5]),
            _ => point(v),
        })),
        text("a footer", "a.csv", of(names, &|_, v| point(v)) + "Mean,3.0,0.0,3.0\nEnd of file\n"),
        text("names that repeat in the middle", "a.csv", lines(|i, v| match i % 100 {
            0 => format!("{names}\n{}", point(v)),
            _ => point(v),
        })),
        ("a header in a code of Japan", "a.csv", [&b"\x8e\x9e\x8d\x8f,\x8ew\x97\xdf,\x91\xac\x93x,\x89\xd7\x8fd\ns,N,rad/s,N\n"[..], lines(|_, v| point(v)).as_bytes()].concat()),
        text("Polish names", "a.csv", of("Czas [s];Siła zadana [N];Prędkość [rad/s];Siła [N]", &|_, v| comma(v))),
    ]
}

/// Files of a third set of kinds, made after the first model file ran on those of the others.
fn others() -> Vec<Foreign> {
    let names = "t,cmd,speed,force";
    let four = |[t, c, v, _, f]: [f64; 5]| [t, c, v, f];
    let with = |v: [f64; 5], between: &str| cells(&four(v)[1..], between);
    let of =
        |head: &str, line: &dyn Fn(usize, [f64; 5]) -> String| format!("{head}\n{}", lines(line));
    let text = |what, name, text: String| (what, name, text.into_bytes());
    let clock = |t: f64| format!("10:00:{t:06.3}");
    let point = |v: [f64; 5]| cells(&four(v), ",");
    vec![
        text("an oscilloscope's settings, with an empty line below", "T0001.csv", of("Model,X24\nWaveform Type,ANALOG\nHorizontal Units,s\nSample Interval,0.01\nRecord Length,300\nVertical Units,V,,\nLabel,,,\n\nTIME,CH1,CH2,CH3", &|_, v| format!("{:.6e},{}", v[0] - 1.5, with(v, ",")))),
        text("segments of an oscilloscope", "C1.csv", of("LX24,24356,Waveform\nSegments,1,SegmentSize,300\nSegment,TrigTime,TimeSinceSegment1\n#1,04-Mar-2026 10:11:12,0\nTime,Ampl1,Ampl2,Ampl3", &|_, v| point(v))),
        text("units in brackets and an empty line", "p.csv", of("Time,Channel A,Channel B,Channel C\n(ms),(V),(V),(mV)\n", &|i, v| format!("{},{}", 10 * i, with(v, ",")))),
        text("settings with a step and a German time", "t.asc", of("T0 = 04.03.2026 10:11:12\ndt = 0,01\n3 Kan\u{e4}le\nZeit 1 - Messrate [s]\tSollkraft [N]\tDrehzahl [rad/s]\tKraft [N]", &|_, v| cells(&four(v), "\t").replace('.', ",")).replace('\n', "\r\n")),
        text("a first column without values", "c.csv", of("origin;X\npath;x-axis;cmd;speed;force\nunit;s;N;rad/s;N", &|_, v| format!(";{}", cells(&four(v), ";")))),
        text("names, start times and a step above the rows", "s.txt", of("channel names:\ncmd\tspeed\tforce\nstart times:\n04.03.2026 10:11:12\t04.03.2026 10:11:12\t04.03.2026 10:11:12\ndt:\n0.010000\t0.010000\t0.010000\ndata:", &|_, v| with(v, "\t"))),
        text("a rate above rows without a time", "r.txt", of("Sample Rate: 100 Hz\nChannels: cmd, speed, force\n", &|_, v| with(v, "\t"))),
        text("frames and their rate", "v.csv", of("Devices\n100\n,,Force,,\nFrame,Sub Frame,Command,Speed,Force\n,,N,rad/s,N", &|i, v| format!("{},0,{}", i + 1, with(v, ",")))),
        text("frames, with kinds and numbers of bodies", "o.csv", of("Format Version,1.23,Take Name,Take 1,Capture Frame Rate,100.000000\n\n,Type,Rigid Body,Rigid Body,Rigid Body\n,Name,cmd,speed,force\n,ID,1,2,3\n,,Position,Position,Position\nFrame,Time,X,X,X", &|i, v| format!("{i},{:.6},{}", v[0], with(v, ",")))),
        text("a counter with T in its name beside times of day", "a.csv", of("\"Status (hex)\",\"RDTSequence\",\"F/T Sequence\",\"Fx\",\"Fy\",\"Fz\",\"Time\"", &|i, v| format!("\"0x00000000\",\"{i}\",\"{}\",\"{}\",\"{}\"", 70 * i, with(v, "\",\""), clock(v[0])))),
        text("stamps of seconds and nanoseconds without names", "e.csv", lines(|i, v| format!("{},{},base,{}", 1_770_000_000 + i / 100, i % 100 * 10_000_000, with(v, ",")))),
        text("a comment of as many words as columns", "m.txt", of("# Created by Octave 8.4.0\n# name: log\n# type: matrix\n# rows: 300\n# columns: 4", &|_, v| cells(&four(v), " "))),
        text("minutes and seconds", "a.csv", of("Elapsed,Command,Velocity,Force", &|_, v| format!("{:02}:{:05.2},{}", 59 + (v[0] / 60.0) as usize, v[0] % 60.0, with(v, ",")))),
        text("microseconds since 1970", "a.csv", of("timestamp,cmd,speed,force", &|i, v| format!("{},{}", 1_770_000_000_000_000_u64 + 10_000 * i as u64, with(v, ",")))),
        text("nanoseconds since 1970", "a.csv", of("%time,field.cmd,field.velocity0,field.force", &|i, v| format!("{},{}", 1_770_000_000_000_000_000_u64 + 10_000_000 * i as u64, with(v, ",")))),
        text("times below zero", "a.csv", of("Time_ms,cmd_N,speed_radps,force_N", &|i, v| format!("{},{}", 10 * i as i64 - 1000, with(v, ",")))),
        text("a counter in hexadecimal", "a.csv", of("cnt,micros,cmd,speed,force", &|i, v| format!("0x{i:04X},{},{}", 10_000 * i, with(v, ",")))),
        text("marks between thousands as in Switzerland", "a.csv", of("Zeit (ms);Sollkraft (mN);Geschwindigkeit (mrad/s);Kraft (mN)", &|i, [_, c, v, _, f]| format!("{};{}'{:03}.5;{:.1};{}'{:03}.5", 10 * i, (1000.0 * c) as usize / 1000, (1000.0 * c) as usize % 1000, 1000.0 * v, (1000.0 * f) as usize / 1000, (1000.0 * f) as usize % 1000))),
        text("comments in the middle", "a.csv", of(names, &|i, v| if i % 60 == 30 { format!("# mark {i}\n{}", point(v)) } else { point(v) })),
        text("an empty line behind each row", "a.csv", of(names, &|_, v| point(v) + "\n")),
        text("a table of pipes", "a.txt", of("| t | cmd | speed | force |\n|---|---|---|---|", &|_, v| format!("| {} |", cells(&four(v), " | ")))),
        text("columns of a fixed width", "a.prn", of("         t       cmd     speed     force", &|_, [t, c, v, _, f]| format!("{t:10.4}{c:10.4}{v:10.4}{f:10.4}"))),
        text("an annotated table of a database", "a.csv", of("#group,false,false,true,false,false,false\n#datatype,string,long,dateTime:RFC3339,double,double,double\n#default,_result,,,,,\n,result,table,_time,cmd,speed,force", &|_, v| format!(",,0,2026-03-04T{}Z,{}", clock(v[0]), with(v, ",")))),
        text("six hundred more columns", "a.csv", of(&format!("{names}{}", (0..600).map(|k| format!(",ch{k}")).collect::<String>()), &|i, v| point(v) + &(0..600).map(|k| format!(",{}", i * k % 7)).collect::<String>())),
        text("desired and measured values of a robot", "a.csv", of("time[ms],tau_J_d[0],dq[0],q[0],tau_J[0]", &|i, [_, c, v, q, f]| format!("{},{}", 10 * i, cells(&[c, v, q, f], ",")))),
    ]
}

/// Files of a fourth set of kinds, made by a reader who had not seen the others: 18 of them ran at
/// first.
fn strangers() -> Vec<Foreign> {
    let with = |v: [f64; 5], between: &str| cells(&[v[1], v[2], v[4]], between);
    let of =
        |head: &str, line: &dyn Fn(usize, [f64; 5]) -> String| format!("{head}\n{}", lines(line));
    let text = |what, name, text: String| (what, name, text.into_bytes());
    let clock = |t: f64| format!("10:00:{t:06.3}");
    let point = |v: [f64; 5]| cells(&[v[0], v[1], v[2], v[4]], ",");
    let comma = |v: [f64; 5]| cells(&[v[0], v[1], v[2], v[4]], ";").replace('.', ",");
    let utf16 = |text: String| {
        let units = "\u{feff}"
            .encode_utf16()
            .chain(text.encode_utf16())
            .collect::<Vec<u16>>();
        units
            .iter()
            .flat_map(|unit| unit.to_le_bytes())
            .collect::<Vec<u8>>()
    };
    let settings = [
        "Record Length,300",
        "Sample Interval,0.01",
        "Trigger Point,0",
        "Source,CH1",
        "Vertical Units,V",
    ];
    vec![
        text("settings beside the first rows", "T0000.csv", lines(|i, v| format!("{},,{:.5},{}", settings.get(i).unwrap_or(&","), v[0], with(v, ",")))),
        text("names with their units in words", "r.csv", of("in s,CH1 in V,CH2 in V,CH3 in V", &|_, v| point(v))),
        text("a resolution and no time", "y.csv", of("\"Header Size\",8\n\"TraceName\",\"cmd\",\"speed\",\"force\"\n\"BlockSize\",300,300,300\n\"VUnit\",\"N\",\"rad/s\",\"N\"\n\"SampleRate\",100.0,100.0,100.0\n\"HResolution\",1.0E-02,1.0E-02,1.0E-02\n\"HUnit\",\"s\",\"s\",\"s\"\n\"Date\",\"2026/03/04\",\"2026/03/04\",\"2026/03/04\"\n\"Time\",\"10:00:00.000000\",\"10:00:00.000000\",\"10:00:00.000000\"\n", &|_, [_, c, v, _, f]| format!(",{c:.5E},{v:.5E},{f:.5E}"))),
        text("thousandths in a column of their own", "g.csv", of("NO.,Time,ms,CH1,CH2,CH3\nNO.,time,ms,N,rad/s,N", &|i, v| format!("{},2026/03/04 10:00:{:02},{:03},{}", i + 1, i / 100, 10 * (i % 100), [v[1], v[2], v[4]].map(|x| format!("{x:+.5}")).join(",")))),
        text("rows that begin with a word", "t.csv", of("Header:,Trend\nPeriod:,10 ms\nHeader:,Date,Time,cmd,speed,force", &|_, v| format!("Data:,03/04/2026,{},{}", clock(v[0]), with(v, ",")))),
        text("rows of a controller, with a mark at the end", "d.csv", of("Record,Date,UTC Time,cmd,speed,force", &|i, v| format!("{},2026-03-04,{},{}", i + 1, clock(v[0]), with(v, ","))) + "//END\n"),
        text("a trace with names in quotation marks", "t.csv", of("Index;Zeit [ms];\"DB1\".Soll;\"DB1\".Drehzahl;\"DB1\".Kraft", &|i, v| format!("{i};{};{}", format!("{:.3}", 1e3 * v[0]).replace('.', ","), with(v, ";").replace('.', ",")))),
        text("names, types and units above the rows", "s.csv", of("time,cmd,speed,force\nType: double,Type: double,Type: double,Type: double\nUnits: s,Units: N,Units: rad/s,Units: N\nInterp: linear,Interp: linear,Interp: linear,Interp: linear", &|_, v| point(v))),
        text("German export with a decimal comma", "w.txt", of("Datei: a.dxd\nStartzeit: 04.03.2026 10:00:00,000\nAbtastrate: 100 Hz\n\nZeit (s)\tSollwert (N)\tDrehzahl (rad/s)\tKraft (N)", &|_, v| comma(v).replace(';', "\t"))),
        text("waveforms of LabVIEW with dates", "v.txt", of("waveform\t[0]\t[1]\t[2]\t\nt0\t04.03.2026 10:00:00,000\t04.03.2026 10:00:00,000\t04.03.2026 10:00:00,000\t\ndelta t\t0,010000\t0,010000\t0,010000\t\n\ntime\tcmd\tspeed\tforce\t", &|_, v| format!("04.03.2026 {}\t{}\t", clock(v[0]), with(v, "\t")).replace('.', ",").replacen("04,03,", "04.03.", 1))),
        text("four lines above the rows, and NAN", "c.dat", of("\"TOA5\",\"CR6\",\"CR6\",\"1\",\"OS\",\"prog\"\n\"TIMESTAMP\",\"RECORD\",\"cmd\",\"speed\",\"force\"\n\"TS\",\"RN\",\"N\",\"rad/s\",\"N\"\n\"\",\"\",\"Smp\",\"Smp\",\"Smp\"", &|i, v| format!("\"2026-03-04 {}\",{i},{}", clock(v[0]), if i % 50 == 7 { "\"NAN\",\"NAN\",\"NAN\"".into() } else { with(v, ",") }))),
        text("a state in hexadecimal, and words for overload", "o.csv", of("time,status,cmd,speed,force", &|i, v| format!("{:.3},0x{:04X},{},{}", v[0], 256 * (i % 7), cells(&v[1..3], ","), if i % 60 == 9 { "OVL".into() } else { format!("{:.5}", v[4]) }))),
        ("UTF-16, thousandths behind a colon", "b.csv", utf16(of("Scan Control:\n,Interval:,0.01\nScan,Time,101 <cmd> (VDC),Alarm 101,102 <speed> (VDC),Alarm 102,103 <force> (VDC),Alarm 103", &|i, v| format!("{},3/14/2026 {},{:.6},0,{:.6},0,{:.6},0", i + 1, clock(v[0]).replace('.', ":"), v[1], v[2], v[4])))),
        text("results above quoted rows", "i.csv", of("\"Results Table 1\"\n\"\",\"Maximum Load\",\"Modulus\"\n\"1\",\"13.5\",\"2.1\"\n\n\"Time\",\"Command\",\"Speed\",\"Load\"\n\"(s)\",\"(N)\",\"(rad/s)\",\"(N)\"", &|_, v| format!("\"{}\"", point(v).replace(',', "\",\"")))),
        ("blanks that do not break between thousands, in cp1252", "f.csv", cp1252(&of("Temps (ms);Consigne (mN);Vitesse (rad/s);Effort mesuré (mN)", &|_, [t, c, v, _, f]| format!("{:.1};{}\u{a0}{:03}.5;{v:.3};{}\u{a0}{:03}.5", 1e3 * t, (1e3 * c) as usize / 1000, (1e3 * c) as usize % 1000, (1e3 * f) as usize / 1000, (1e3 * f) as usize % 1000).replace('.', ",")))),
        text("errors of a spreadsheet in a column", "e.csv", of("Tempo;Comando;Velocità;Forza;Abilitato;Rapporto", &|i, v| format!("{};{};{}", comma(v), ["SI", "NO"][usize::from(i % 7 == 0)], if (30..200).contains(&i) { format!("{:.3}", v[1] / v[4]).replace('.', ",") } else { "#DIV/0!".into() }))),
        text("blanks, and forty columns of a robot", "u.csv", of(&format!("timestamp target_current_2 actual_qd_2 actual_current_2{}", (0..36).map(|k| format!(" output_{k}")).collect::<String>()), &|i, v| format!("{:.5} {}{}", v[0], with(v, " "), (0..36).map(|k| format!(" {}", i * k % 5)).collect::<String>()))),
        text("lines of a system's log", "l.log", lines(|i, v| format!("2026-03-04T{}Z rig logger[{}]: cmd={:.4} speed={:.4} force={:.4}", clock(v[0]), 311 + i % 2, v[1], v[2], v[4]))),
        text("a frequency above rows without a time", "q.tsv", of("NO_OF_SAMPLES\t300\nTOT_NO_OF_CHAN\t3\nFREQUENCY\t100\nTIME_STAMP\t2026-03-04, 10:00:00.123\t12345.678\nFIRST_SAMPLE\t1\nCHANNEL_NAMES\tcmd\tspeed\tforce\nCHANNEL_GAIN\t1\t1\t1", &|_, v| with(v, "\t"))),
        text("a storage file with endheader", "o.sto", of("force\nversion=1\nnRows=300\nnColumns=5\ninDegrees=no\nendheader\ntime\tcmd\tspeed\tangle\tforce", &|_, v| cells(&v, "\t"))),
        text("samples a millisecond above the names", "a.txt", of("a.acq\n10 msec/sample\n3 channels\ncmd\nN\nspeed\nrad/s\nforce\nN\nsec,CH1,CH2,CH3,", &|_, v| point(v).replace(',', "\t") + "\t")),
        text("titles of channels in a line", "c.txt", of("Interval=\t0.01 s\nExcelDateTime=\t4.6E4\nTimeFormat=\tStartOfBlock\nChannelTitle=\tcmd\tspeed\tforce\nRange=\t10 N\t10 rad/s\t10 N", &|_, v| format!("{:.5}\t{}", v[0], with(v, "\t")))),
        text("stamps in brackets of a terminal", "p.log", lines(|i, v| format!("[2026-03-04 {}] {}", clock(v[0]), if i == 0 { "cmd,speed,force".into() } else { with(v, ",") }))),
        text("times with nanoseconds and a zone", "p.csv", of(",cmd,speed,force", &|i, v| format!("2026-03-04 10:00:{:02}.{:09}+00:00,{}", i / 100, 10_000_000 * (i % 100), with(v, ",")))),
        text("a reading and its unit in columns of their own", "m.csv", of("Index,Relative Time,Reading,Unit,cmd,speed,Out of limits", &|i, v| format!("{},{:.5},{:.5},N,{},F", i + 1, v[0], v[4], cells(&v[1..3], ",")))),
    ]
}

/// A column: its name and its cells.
type Column = (&'static str, Vec<String>);

/// Logs in JSON: of programs that write an object a line, of pandas and of scripts.
fn objects() -> Vec<Foreign> {
    let named = |v: [f64; 5]| {
        format!(
            "{{\"t\": {:.5}, \"command\": {:.5}, \"speed\": {:.5}, \"force\": {:.5}}}",
            v[0], v[1], v[2], v[4]
        )
    };
    let column = |of: &dyn Fn([f64; 5]) -> f64| -> Vec<String> {
        (0..ROWS).map(|i| format!("{:.5}", of(at(i)))).collect()
    };
    let columns = || {
        [
            ("t", column(&|v| v[0])),
            ("command", column(&|v| v[1])),
            ("speed", column(&|v| v[2])),
            ("force", column(&|v| v[4])),
        ]
    };
    let joined = |of: &dyn Fn(&Column) -> String| {
        let all: Vec<String> = columns().iter().map(of).collect();
        format!("{{{}}}", all.join(","))
    };
    let keyed = |cells: &[String]| {
        let all = cells.iter().enumerate();
        all.map(|(i, c)| format!("\"{i}\":{c}"))
            .collect::<Vec<_>>()
            .join(",")
    };
    let list = |line: &dyn Fn([f64; 5]) -> String| {
        let all: Vec<String> = (0..ROWS).map(|i| line(at(i))).collect();
        format!("[{}]", all.join(",\n"))
    };
    let text = |what, name, text: String| (what, name, text.into_bytes());
    vec![
        text("an object a line", "a.jsonl", lines(|_, v| named(v))),
        text("a list of objects", "a.json", list(&named)),
        text(
            "rows under a name",
            "a.json",
            format!("{{\"rig\": \"left\", \"rows\": {}}}", list(&named)),
        ),
        text(
            "columns of pandas",
            "a.json",
            joined(&|(n, cells)| format!("\"{n}\":{{{}}}", keyed(cells))),
        ),
        text(
            "columns as lists",
            "a.json",
            joined(&|(n, cells)| format!("\"{n}\":[{}]", cells.join(","))),
        ),
        text(
            "pandas, split",
            "a.json",
            format!(
                "{{\"columns\":[\"t\",\"command\",\"speed\",\"force\"],\"data\":{}}}",
                list(&|v| format!("[{}]", cells(&[v[0], v[1], v[2], v[4]], ",")))
            ),
        ),
        text(
            "messages of a robot, one cut off",
            "a.log",
            lines(|i, v| {
                format!("{{\"header\": {{\"stamp\": {{\"sec\": {}, \"nanosec\": {}}}, \"frame_id\": \"\"}}, \"velocity\": [{:.5}], \"command\": {:.5}, \"effort\": [{:.5}]}}", 1_770_000_000 + i / 100, i % 100 * 10_000_000, v[2], v[1], v[4])
            }) + "{\"header\": {\"sta",
        ),
        text(
            "NaN, and stamps as text",
            "a.ndjson",
            lines(|i, v| {
                format!("{{\"time\": \"2026-03-04T10:00:{:06.3}Z\", \"command\": {:.5}, \"speed\": {:.5}, \"force\": {}}}", v[0], v[1], v[2], if i % 40 == 9 { "NaN".into() } else { format!("{:.5}", v[4]) })
            }),
        ),
    ]
}

/// A table of columns, compressed with zstd as pandas and polars can.
#[cfg(feature = "parquet")]
fn zstd() -> Vec<u8> {
    use crate::load::tests::put_column;
    use parquet::basic::{Compression, ZstdLevel};
    use parquet::data_type::DoubleType;
    use parquet::file::{properties::WriterProperties, writer::SerializedFileWriter};
    use std::sync::Arc;
    let names = ["t", "command", "speed", "angle", "force"];
    let columns: String = names
        .iter()
        .map(|n| format!("required double {n}; "))
        .collect();
    let schema = format!("message log {{ {columns}}}");
    let schema = parquet::schema::parser::parse_message_type(&schema).unwrap();
    let zstd = Compression::ZSTD(ZstdLevel::default());
    let properties = WriterProperties::builder().set_compression(zstd).build();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.parquet");
    let file = std::fs::File::create(&path).unwrap();
    let mut writer =
        SerializedFileWriter::new(file, Arc::new(schema), Arc::new(properties)).unwrap();
    let mut group = writer.next_row_group().unwrap();
    for k in 0..names.len() {
        let column: Vec<f64> = (0..ROWS).map(|i| at(i)[k]).collect();
        put_column::<DoubleType>(&mut group, &column);
    }
    group.close().unwrap();
    writer.close().unwrap();
    std::fs::read(&path).unwrap()
}

/// What keeps the first model file for a log from running: a file that is not written, one that is
/// no model, one that does not read the log, that leaves out more than half of it, or that has
/// another rate than 100 rows per second.
fn fails(name: &str, bytes: &[u8]) -> Option<String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    let text = match guess(std::slice::from_ref(&path)) {
        Ok(text) => text,
        Err(why) => return Some(why.to_string()),
    };
    let spec = match Spec::parse(&text) {
        Ok(spec) => spec,
        Err(why) => return Some(format!("{why}\n{text}")),
    };
    match crate::load::load(&[path], &spec) {
        Ok(data) if (data.frame().step() - 0.01).abs() > 1e-6 => {
            Some(format!("a row each {} s\n{text}", data.frame().step()))
        }
        Ok(data) if 2 * data.kept_rows().len() >= ROWS => None,
        Ok(data) => Some(format!("{} of {ROWS} rows\n{text}", data.kept_rows().len())),
        Err(why) => Some(format!("{why}\n{text}")),
    }
}

/// How many files the first model file runs on is printed with `-- --nocapture`.
fn count(all: &[Foreign], length: usize) {
    let mut failures = Vec::new();
    for (what, name, bytes) in all {
        let why = fails(name, bytes);
        println!("{}  {what}", if why.is_none() { "runs" } else { "FAILS" });
        failures.extend(why.map(|why| format!("{what}: {why}")));
    }
    let ran = all.len() - failures.len();
    println!("{ran} of {} run", all.len());
    assert_eq!(all.len(), length);
    assert!(failures.is_empty(), "{ran} run:\n{}", failures.join("\n\n"));
}

#[cfg(feature = "parquet")]
#[test]
fn the_first_model_file_runs_on_nearly_all_foreign_files() {
    let mut all = texts();
    all.push(("Parquet with zstd", "a.parquet", zstd()));
    count(&all, ALL);
}

#[test]
fn the_first_model_file_runs_on_files_of_further_kinds() {
    count(&further(), ALL);
}

#[test]
fn the_first_model_file_runs_on_files_of_a_third_set_of_kinds() {
    count(&others(), ALL);
}

#[test]
fn the_first_model_file_runs_on_files_of_a_stranger() {
    count(&strangers(), ALL);
}

#[test]
fn the_first_model_file_runs_on_json() {
    count(&objects(), 8);
}
